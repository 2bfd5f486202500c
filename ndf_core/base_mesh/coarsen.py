"""From a dense manifold mesh to a base mesh of a given number of faces, with every check."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.base_mesh.intersections import intersection_remark, self_intersections
from ndf_core.base_mesh.split import even_edge_length, split_long_edges
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh, Remark
from ndf_core.kernels.decimate import Decimated, decimate
from ndf_core.mesh import topology

SPLIT = 0.5
"""Edges longer than this many even edge lengths of the base mesh are halved first."""
RETRIES = 6
EMPHASIS = 8.0
"""Factor on the error around a self-intersection in each retry, so that more faces stay there."""


def coarsen(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    max_faces: int,
    *,
    remarks: Sequence[Remark] = (),
) -> BaseMesh:
    """Decimate a manifold mesh, closed or with boundary, to about `max_faces` well-shaped faces.

    Laws: Euler characteristic, components and boundary loops are those of the input; the mesh passes
    `check_base_mesh`; it does not intersect itself where the input does not, or a remark says where.

    Args:
        vertices: Any units; the base mesh is in the same.
        faces: An oriented manifold, outwards where closed.
        max_faces: At most so many, and close to it, also where the input has fewer: its long edges are split.
        remarks: What is known already; the base mesh carries them too.

    Raises:
        BaseMeshError: the input is not such a mesh.
    """
    dense = topology(faces, len(vertices))
    if not dense.manifold:
        raise BaseMeshError(f"only a manifold mesh can be coarsened, this one is not: {dense}")
    vertices, faces = split_long_edges(
        vertices, faces, SPLIT * even_edge_length(vertices, faces, max_faces), 4 * len(faces) + 40 * max_faces
    )
    result, found = _without_new_intersections(vertices, faces, max_faces)
    mesh = BaseMesh(result.vertices, result.faces, (*remarks, *found))
    check_base_mesh(
        mesh, closed=dense.closed, euler_characteristic=dense.euler_characteristic, components=dense.components
    )
    if len(result.faces) > max_faces:
        mesh = BaseMesh(result.vertices, result.faces, (*mesh.remarks, _not_reached(len(result.faces), max_faces)))
    return mesh


def _not_reached(reached: int, max_faces: int) -> Remark:
    message = (
        f"{reached} faces were reached, {max_faces} asked for: with fewer, the base mesh would lose a handle or a "
        f"component, fold over or get faces without area"
    )
    return Remark(kind="faces_not_reached", message=message, count=reached)


def _without_new_intersections(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], max_faces: int
) -> tuple[Decimated, list[Remark]]:
    """Decimate; where the result runs through itself and the input does not, again with more faces there."""
    best = decimate(vertices, faces, max_faces)
    pairs = self_intersections(best.vertices, best.faces)
    if not len(pairs):
        return best, []
    inherited = np.unique(faces[np.unique(self_intersections(vertices, faces))])
    fewest, best_pairs, result = len(_new_pairs(best, pairs, inherited)), pairs, best
    weights = np.ones(len(vertices))
    for _ in range(RETRIES):
        new = _new_pairs(result, pairs, inherited)
        if not len(new):
            break
        weights[np.isin(result.cluster, _neighbourhood(result.faces, np.unique(new)))] *= EMPHASIS
        result = decimate(vertices, faces, max_faces, weights=weights)
        pairs = self_intersections(result.vertices, result.faces)
        count = len(_new_pairs(result, pairs, inherited))
        if count < fewest:
            fewest, best_pairs, best = count, pairs, result
    if not len(best_pairs):
        return best, []
    return best, [intersection_remark(best.vertices, best.faces, best_pairs, "the base mesh")]


def _new_pairs(result: Decimated, pairs: Int[Array, "k 2"], inherited: Int[Array, " n"]) -> Int[Array, "l 2"]:
    """Pairs that touch no place where the input intersects itself; `inherited`: vertices of the input there."""
    old = np.isin(result.faces, result.cluster[inherited]).any(axis=1)
    return pairs[~(old[pairs].any(axis=1))]


def _neighbourhood(faces: Int[Array, "f 3"], some: Int[Array, " k"]) -> Int[Array, " n"]:
    """Vertices of the given faces and of every face next to them."""
    return np.unique(faces[np.isin(faces, faces[some]).any(axis=1)])
