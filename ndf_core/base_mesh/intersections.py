"""Where a mesh runs through itself, and how that is said in a remark."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.remarks import triple
from ndf_core.interfaces import Remark
from ndf_core.kernels.bvh import TriangleBVH


def self_intersections(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Int[Array, "k 2"]:
    """Pairs of faces that meet elsewhere than in the vertices or the edge that they share."""
    return TriangleBVH(vertices, faces).self_intersections()


def intersecting_area(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], pairs: Int[Array, "k 2"]) -> float:
    """Share of the mesh's area in faces that are in a pair."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(area[np.unique(pairs)].sum() / area.sum()) if len(pairs) else 0.0


def intersection_remark(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], pairs: Int[Array, "k 2"], whose: str
) -> Remark:
    """Remark of kind "self_intersections": how many pairs, in how many places, and where the largest place is."""
    involved = np.unique(pairs)
    label = _places(faces, pairs)
    largest = involved[label == np.bincount(label).argmax()]
    points = vertices[faces[largest]].reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    share = intersecting_area(vertices, faces, pairs)
    return Remark(
        kind="self_intersections",
        message=(
            f"{len(pairs)} pairs of faces of {whose} intersect, in {int(label.max()) + 1} places with "
            f"{100 * share:.2g}% of its area"
        ),
        position=triple(0.5 * (low + high)),
        size=float(np.linalg.norm(high - low)),
        count=len(pairs),
    )


def _places(faces: Int[Array, "f 3"], pairs: Int[Array, "k 2"]) -> Int[Array, " i"]:
    """For each involved face (ascending) the number of its place: pairs and faces with a common vertex are joined."""
    involved, local = np.unique(pairs, return_inverse=True)
    local = local.reshape(-1, 2)
    _, corners = np.unique(faces[involved], return_inverse=True)
    corners = corners.reshape(-1, 3) + len(involved)
    rows = np.arange(len(involved))
    links = np.concatenate([local, *(np.stack([rows, corners[:, i]], axis=1) for i in range(3))])
    return _components(links, len(involved) + int(corners.max()) + 1)[: len(involved)]


def _components(links: Int[Array, "m 2"], count: int) -> Int[Array, " n"]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(links), dtype=np.int8), (links[:, 0], links[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]
