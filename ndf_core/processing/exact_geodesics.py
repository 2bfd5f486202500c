"""Exact distances on the triangles: Mitchell, Mount and Papadimitriou's algorithm (pygeodesic)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.delaunay import straight_lengths
from ndf_core.kernels.variation import vary_distances
from ndf_core.processing.face_curvature import face_curvature, lengths_of_mean
from ndf_core.processing.insertion import insert_points
from ndf_core.processing.operators import Operators
from ndf_core.processing.surface_points import SurfacePoints


def exact_distances(operators: Operators, sources: SurfacePoints) -> tuple[Float[Array, " v"], int]:
    """Distance of each vertex to the nearest of the sources along the surface; infinity where none is connected.

    Sources are where they are: the face or edge around one is split, which leaves the surface and its distances as
    they are. Where the operators have edge lengths of a curved surface, distances on the flat triangles are corrected
    to first order: every path gets the length that the surface has along it, with curvature inside faces. Time
    grows like v^1.5 or so: 10,000 vertices take 0.3 s, 86,000 take 18 s.

    Returns:
        The distances, and how many of them the algorithm missed. pygeodesic's reports some rare vertices as
        unreachable; they get the shortest detour over a neighbour, too long by less than an edge.

    Reference: Mitchell, Mount, Papadimitriou 1987; Surazhsky et al. 2005.
    """
    from pygeodesic.geodesic import PyGeodesicAlgorithmExact

    vertices, faces, inserted = insert_points(operators.vertices, operators.faces, sources)
    found, _ = PyGeodesicAlgorithmExact(vertices, faces).geodesicDistances(np.unique(inserted), None)
    distances = np.array(found, dtype=np.float64)
    reached = np.zeros(int(operators.components.max()) + 1, dtype=bool)
    reached[operators.components[operators.faces[sources.faces, 0]]] = True
    connected = np.ones(len(vertices), dtype=bool)
    connected[: len(operators.vertices)] = reached[operators.components]
    missed = connected & ~np.isfinite(distances)
    _detour(vertices, faces, distances, missed)
    return _on_surface(operators, sources, distances[: len(operators.vertices)]), int(missed.sum())


def straight_to(operators: Operators, sources: SurfacePoints, points: SurfacePoints) -> Float[Array, " n"]:
    """Length of the straight line to the nearest source in the same face; infinite where there is none."""
    found = np.full(len(points.faces), np.inf)
    near = np.flatnonzero(np.isin(points.faces, sources.faces))
    for face, weights in zip(sources.faces, sources.barycentric, strict=True):
        here = near[points.faces[near] == face]
        lengths = straight_lengths(operators.vertices, operators.faces[face : face + 1])
        if operators.edge_lengths is not None:
            lengths = operators.edge_lengths[face : face + 1]
        found[here] = np.minimum(found[here], _apart(lengths, points.barycentric[here] - weights))
    return found


def _on_surface(operators: Operators, sources: SurfacePoints, distances: Float[Array, " v"]) -> Float[Array, " v"]:
    """Distances on flat triangles, made those under the edge lengths of the surface where they are known."""
    if operators.edge_lengths is None:
        return distances
    flat, curved = straight_lengths(operators.vertices, operators.faces), operators.edge_lengths
    curved = lengths_of_mean(curved, face_curvature(operators.vertices, operators.faces, curved))
    known = np.full(len(distances), np.nan)
    corners = operators.faces[sources.faces]
    for i in range(3):  # a source is seen from the corners of its face, where no other is nearer
        offsets = np.eye(3)[i] - sources.barycentric
        straight, bent = (_apart(lengths[sources.faces], offsets) for lengths in (flat, curved))
        seen = straight <= distances[corners[:, i]] * (1 + 1e-9)
        known[corners[seen, i]] = (bent - straight)[seen]
    shifts = vary_distances(operators.faces, flat, curved, distances, known)
    return np.where(np.isfinite(distances), np.maximum(distances + shifts, 0.0), distances)


def _apart(lengths: Float[Array, "#n 3"], offsets: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance of two points of a triangle, whose barycentric coordinates differ by the offsets, by its sides."""
    x, y, z = offsets.T
    ab, bc, ca = lengths.T**2
    return np.sqrt(np.maximum(-(ab * x * y + bc * y * z + ca * z * x), 0.0))


def _detour(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], distances: Float[Array, " v"], missed: Bool[Array, " v"]
) -> None:
    """Set the missed distances, in place, to the shortest way over a neighbour, until nothing changes."""
    start = np.concatenate([faces.ravel(), faces[:, [1, 2, 0]].ravel()])
    end = np.concatenate([faces[:, [1, 2, 0]].ravel(), faces.ravel()])
    wanted = missed[end]
    start, end = start[wanted], end[wanted]
    length = np.linalg.norm(vertices[start] - vertices[end], axis=1)
    while len(start):
        before = distances.copy()
        np.minimum.at(distances, end, distances[start] + length)
        if np.array_equal(before, distances):
            return
