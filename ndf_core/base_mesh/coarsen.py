"""From a dense manifold mesh to a base mesh of a given number of faces, with every check."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import check_base_mesh, longest_side
from ndf_core.base_mesh.intersections import intersecting_area, intersection_remark, self_intersections
from ndf_core.base_mesh.split import even_edge_length, split_long_edges
from ndf_core.base_mesh.thickness import thin_weights
from ndf_core.base_mesh.untangle import untangle
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh, Remark
from ndf_core.kernels.decimate import Decimated, decimate
from ndf_core.mesh import topology

SPLIT = 0.5
"""Edges longer than this many even edge lengths of the base mesh are halved first."""
MOST_SPLIT = 4_000_000
"""Faces after splitting, at most, or twice the faces asked for: what decimation takes a few gigabytes for."""
RETRIES = 5
"""Decimations that may be tried to be rid of self-intersections; one where the input has many of its own."""
EMPHASIS = 8.0
"""Factor on the error around a self-intersection in each retry, so that more faces stay there."""
THIN = 5e-4
"""Least altitude of a face, as a share of the longest side ..."""
THIN_EVEN = 0.02
"""... and of the even edge length, whichever is less: far-apart parts and very many faces need thin ones."""
UNDONE_AREA = 0.001
"""Self-intersections of the input in a smaller share of its area are treated like those that decimation makes."""

Importance = Callable[[Float[Array, "n 3"]], Float[Array, " n"]]
"""Positive factors of the error at points: where they are large, more faces stay."""


def coarsen(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    max_faces: int,
    *,
    remarks: Sequence[Remark] = (),
    importance: Importance | None = None,
) -> BaseMesh:
    """Decimate a manifold mesh, closed or with boundary, to about `max_faces` well-shaped faces.

    Laws: Euler characteristic, components and boundary loops are those of the input; the mesh passes
    `check_base_mesh`; it does not intersect itself where the input does not, or a remark says where.

    Args:
        vertices: Any units; the base mesh is in the same.
        faces: An oriented manifold, outwards where closed.
        max_faces: At most so many, and close to it, also where the input has fewer: its long edges are split.
        remarks: What is known already; the base mesh carries them too.
        importance: Factor of the error at each point; none: 1 everywhere.

    Raises:
        BaseMeshError: the input is not such a mesh.
    """
    dense = topology(faces, len(vertices))
    if not dense.manifold:
        raise BaseMeshError(f"only a manifold mesh can be coarsened, this one is not: {dense}")
    most = min(4 * len(faces) + 40 * max_faces, max(MOST_SPLIT, 2 * max_faces))
    length = SPLIT * even_edge_length(vertices, faces, max_faces)
    vertices, faces = split_long_edges(vertices, faces, length, most)
    target = max_faces
    while True:
        mesh = _without_new_intersections(vertices, faces, target, importance)
        try:
            check_base_mesh(
                mesh,
                closed=dense.closed,
                euler_characteristic=dense.euler_characteristic,
                components=dense.components,
            )
            break
        except BaseMeshError:
            # So few faces that a component turned inside out or lost its volume: allow it more.
            if target >= len(faces):
                raise
            target += max(4, target // 2)
    found = (*remarks, *mesh.remarks)
    if len(mesh.faces) > max_faces:
        found = (*found, _not_reached(len(mesh.faces), max_faces))
    return BaseMesh(mesh.vertices, mesh.faces, found)


def _not_reached(reached: int, max_faces: int) -> Remark:
    message = (
        f"{reached} faces were reached, {max_faces} asked for: with fewer, the base mesh would lose a handle or a "
        f"component, turn inside out, fold over or get faces without area"
    )
    return Remark(kind="faces_not_reached", message=message, count=reached)


def _without_new_intersections(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], max_faces: int, importance: Importance | None
) -> BaseMesh:
    """Decimate; where the result runs through itself and the input does not, untangle it, or decimate again with more
    faces there."""
    edge = even_edge_length(vertices, faces, max_faces)
    weights, attempts = thin_weights(vertices, faces, edge), list[tuple[int, BaseMesh]]()
    if importance is not None:
        weights = weights * importance(vertices)
    inherited: Int[Array, " n"] | None = None
    thinnest = min(THIN, THIN_EVEN * edge / longest_side(vertices))
    while len(attempts) < (RETRIES if inherited is None or not len(inherited) else 1):
        result = decimate(vertices, faces, max_faces, weights=weights, altitude=thinnest)
        points, pairs = result.vertices, self_intersections(result.vertices, result.faces)
        if len(pairs) and inherited is None:
            inherited = _inherited(vertices, faces)
        new = pairs if inherited is None else _new_pairs(result, pairs, inherited)
        if len(new) == len(pairs):
            points, pairs = untangle(points, result.faces, pairs)
            new = pairs
        remarks = [intersection_remark(points, result.faces, pairs, "the base mesh")] if len(pairs) else []
        attempts.append((len(new), BaseMesh(points, result.faces, tuple(remarks))))
        if not len(new):
            break
        weights[np.isin(result.cluster, _neighbourhood(result.faces, np.unique(new)))] *= EMPHASIS
    return min(attempts, key=lambda attempt: attempt[0])[1]


def _inherited(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Int[Array, " n"]:
    """Vertices where the input intersects itself so much that the base mesh may; in a few faces it can be undone."""
    pairs = self_intersections(vertices, faces)
    if intersecting_area(vertices, faces, pairs) <= UNDONE_AREA:
        return np.zeros(0, dtype=np.int64)
    return np.unique(faces[np.unique(pairs)]).astype(np.int64)


def _new_pairs(result: Decimated, pairs: Int[Array, "k 2"], inherited: Int[Array, " n"]) -> Int[Array, "l 2"]:
    """Pairs that touch no place where the input intersects itself; `inherited`: vertices of the input there."""
    old = np.asarray(np.isin(result.faces, result.cluster[inherited]).any(axis=1))
    return pairs[np.logical_not(old[pairs].any(axis=1))]


def _neighbourhood(faces: Int[Array, "f 3"], some: Int[Array, " k"]) -> Int[Array, " n"]:
    """Vertices of the given faces and of every face next to them."""
    return np.unique(faces[np.isin(faces, faces[some]).any(axis=1)])
