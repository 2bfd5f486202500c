"""Distances between the vertices, to second order."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.mesh import unit, vertex_directions, vertex_normals
from ndf_core.processing.operators import Operators


def distances_at_middles(operators: Operators, distances: Float[Array, " v"]) -> Float[Array, "f 3"]:
    """Distances of the edges' middles, edge i from corner i to corner i + 1.

    Fronts are curved, so distances are not linear along edges: they bend as their slopes at the ends tell. A slope at
    a vertex is that of a unit vector in the mean direction of the faces' gradients: distances grow like lengths.

    Laws: a middle is no farther from either end than half the edge; infinite where the ends are.
    """
    vertices, faces = operators.vertices, operators.faces
    ends = np.roll(faces, -1, axis=1)
    edges = vertices[ends] - vertices[faces]
    chords = np.linalg.norm(edges, axis=2)
    lengths = chords if operators.edge_lengths is None else operators.edge_lengths
    normals = vertex_normals(vertices, faces)
    growth = vertex_directions(vertices, faces, _gradients(vertices, faces, distances))
    growth = unit(growth - (growth * normals).sum(axis=1, keepdims=True) * normals)
    with np.errstate(invalid="ignore"):
        bends = _slopes(edges, chords, normals[faces], growth[faces])
        bends -= _slopes(edges, chords, normals[ends], growth[ends])
        mean = 0.5 * (distances[faces] + distances[ends])
        half = 0.5 * (lengths - np.abs(distances[faces] - distances[ends]))
        return mean + np.clip(lengths * bends / 8, -np.maximum(half, 0.0), np.maximum(half, 0.0))


def interpolate_distances(
    corners: Float[Array, "n 3"], middles: Float[Array, "n 3"], barycentric: Float[Array, "n 3"]
) -> Float[Array, " n"]:
    """Quadratic in each face, through its corners and its edges' middles; infinite where these are."""
    x = barycentric
    reached = np.isfinite(corners).all(axis=1)
    found = np.full(len(x), np.inf)
    x, corners, middles = x[reached], corners[reached], middles[reached]
    found[reached] = (x * (2 * x - 1) * corners + 4 * x * np.roll(x, -1, axis=1) * middles).sum(axis=1)
    return np.maximum(found, 0.0)


def _gradients(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], distances: Float[Array, " v"]
) -> Float[Array, "f 3"]:
    """Of distances in the faces, times the square of twice the area; zero where distances are infinite."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    at_a, at_b, at_c = np.where(np.isfinite(distances), distances, 0.0)[faces].T[..., None]
    return np.cross(np.cross(b - a, c - a), at_a * (c - b) + at_b * (a - c) + at_c * (b - a))


def _slopes(
    edges: Float[Array, "f 3 3"],
    chords: Float[Array, "f 3"],
    normals: Float[Array, "f 3 3"],
    growth: Float[Array, "f 3 3"],
) -> Float[Array, "f 3"]:
    """Of distances along each edge at one of its ends: along the edge, and in the tangent plane there."""
    rise = np.einsum("fek,fek->fe", edges, normals)
    tangent = np.sqrt(np.maximum(chords**2 - rise**2, 0.0))
    return np.einsum("fek,fek->fe", edges, growth) / np.where(tangent > 0, tangent, np.inf)
