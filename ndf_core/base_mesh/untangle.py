"""Removal of a few self-intersections from a coarse mesh by moving vertices; the triangles stay."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.intersections import self_intersections
from ndf_core.mesh import face_normals

ROUNDS = 12
STEP = 0.5
"""Share of the way to the mean of the neighbours that a vertex goes in a round."""
MIN_COSINE = 0.5
"""No triangle turns by more than 60 degrees altogether."""


def untangle(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], pairs: Int[Array, "k 2"]
) -> tuple[Float[Array, "v 3"], Int[Array, "l 2"]]:
    """Smooth the vertices of intersecting faces, round by round, until there are none or none can move.

    Two sheets that press into each other are each flattened to their own side, which parts them.

    Args:
        pairs: The self-intersections of the mesh.

    Returns:
        The vertices after the round with the fewest self-intersections, and these.
    """
    if not len(pairs):
        return vertices, pairs
    before = face_normals(vertices, faces)
    best, best_pairs, points = vertices, pairs, vertices
    for _ in range(ROUNDS):
        moved = _smoothed(points, faces, np.unique(faces[np.unique(pairs)]))
        turned = _turned(before, face_normals(moved, faces))
        held = np.unique(faces[turned])
        points = moved.copy()
        points[held] = vertices[held]
        if _turned(before, face_normals(points, faces)).any():
            break
        pairs = self_intersections(points, faces)
        if len(pairs) < len(best_pairs):
            best, best_pairs = points, pairs
        if not len(pairs):
            break
    return best, best_pairs


def _smoothed(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], chosen: Int[Array, " n"]
) -> Float[Array, "v 3"]:
    """Move the chosen vertices towards the means of their neighbours (each counted once per common face)."""
    rows = np.flatnonzero(np.isin(faces, chosen).any(axis=1))
    total, count = np.zeros_like(vertices), np.zeros(len(vertices))
    for corner in range(3):
        for other in (faces[rows, (corner + 1) % 3], faces[rows, (corner + 2) % 3]):
            np.add.at(total, faces[rows, corner], vertices[other])
            np.add.at(count, faces[rows, corner], 1.0)
    points = vertices.copy()
    points[chosen] += STEP * (total[chosen] / count[chosen, None] - vertices[chosen])
    return points


def _turned(before: Float[Array, "f 3"], after: Float[Array, "f 3"]) -> Array:
    lengths = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return np.einsum("ij,ij->i", before, after) < MIN_COSINE * lengths
