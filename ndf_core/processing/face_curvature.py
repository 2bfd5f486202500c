"""Curvature inside faces, of a surface that is known by its vertices and by edge lengths along it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.mesh_check import check_mesh
from ndf_core.mesh import vertex_normals
from ndf_core.processing.triangles import areas

_THINNEST = 1e-3
"""Area over the sum of squared edges, below which a face's curvature is taken as zero; 0.14 if equilateral."""
_MOST_BENT = 0.1
"""Of squared lengths; beyond it a face is too coarse to tell."""


def face_curvature(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], edge_lengths: Float[Array, "f 3"]
) -> Float[Array, " f"]:
    """Gaussian curvature of each face, in one over the square of the vertices' unit.

    Two things tell it: the angle defects at its corners (Gauss and Bonnet), and its second fundamental form, which
    the bulges of its three edges determine. What has one sign in both is curved by the smaller of the two; the rest
    is flat. A polyhedron has defects without bulges, a rounded edge bulges without defects: both are flat inside.

    Law: a share of a round sphere's, from below, that goes to one as edges shorten; zero where edges are straight.

    Args:
        vertices: On the surface.
        faces: A manifold along its edges.
        edge_lengths: Along the surface, from corner i to corner i + 1; at least the distances of the ends.
    """
    area = areas(edge_lengths)
    twins = check_mesh(faces, len(vertices)).twins
    by_defects = _from_defects(len(vertices), faces, twins, edge_lengths, area)
    by_bulges = _from_bulges(_bulges(vertices, faces, edge_lengths), area)
    told = (by_defects * by_bulges > 0) & (area > _THINNEST * (edge_lengths**2).sum(axis=1))
    return np.where(told, np.sign(by_defects) * np.minimum(np.abs(by_defects), np.abs(by_bulges)), 0.0)


def lengths_of_mean(edge_lengths: Float[Array, "f 3"], curvature: Float[Array, " f"]) -> Float[Array, "f 3"]:
    """Sides of flat triangles in which lines have, on average, the lengths that they have in the curved faces.

    To leading order, the square of the line between two sides, at shares s of both from their common corner, is
    4/3 K A^2 s^2 (1 - s^2) more than in the flat triangle of the same sides, by the law of cosines. The mean over all
    lines parallel to the third side is that of a triangle with 2/3 K A^2 more to the square of that side. So the two
    faces of an edge give it different lengths. A line along the edge itself is as long as it was, but few are.

    Args:
        edge_lengths: Along the surface, from corner i to corner i + 1.
        curvature: Gaussian. What would change squared lengths by more than a tenth counts as a tenth.
    """
    squares = edge_lengths**2
    most = _MOST_BENT * squares.min(axis=1)
    return np.sqrt(squares + np.clip(2 / 3 * curvature * areas(edge_lengths) ** 2, -most, most)[:, None])


def _from_defects(
    count: int,
    faces: Int[Array, "f 3"],
    twins: Int[Array, "f 3"],
    lengths: Float[Array, "f 3"],
    area: Float[Array, " f"],
) -> Float[Array, " f"]:
    """Mean over the corners of the angle that is missing there over the area around; on the border none is."""
    squares = lengths**2
    opposite = np.arctan2(4 * area[:, None], squares.sum(axis=1, keepdims=True) - 2 * squares)
    angles = np.bincount(faces.ravel(), np.roll(opposite, -1, axis=1).ravel(), count)
    around = np.bincount(faces.ravel(), np.repeat(area / 3, 3), count)
    inner = around > 0
    inner[faces[twins < 0]] = False
    inner[np.roll(faces, -1, axis=1)[twins < 0]] = False
    return np.divide(2 * np.pi - angles, around, out=np.zeros(count), where=inner)[faces].mean(axis=1)


def _bulges(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], lengths: Float[Array, "f 3"]
) -> Float[Array, "f 3"]:
    """The second fundamental form along each edge, times its squared length: an arc is longer than its chord by the
    share (chord * curvature)^2 / 24. Positive where normals diverge."""
    edges = vertices[np.roll(faces, -1, axis=1)] - vertices[faces]
    chords = np.linalg.norm(edges, axis=2)
    normals = vertex_normals(vertices, faces)
    turns = ((normals[np.roll(faces, -1, axis=1)] - normals[faces]) * edges).sum(axis=2)
    return np.sign(turns) * np.sqrt(24 * np.maximum(lengths - chords, 0.0) * chords)


def _from_bulges(form: Float[Array, "f 3"], area: Float[Array, " f"]) -> Float[Array, " f"]:
    """Determinant of the form over that of the metric; both are known by their values along three edges."""
    determinant = (form.sum(axis=1) ** 2 - 2 * (form**2).sum(axis=1)) / 16
    return np.divide(determinant, area**2, out=np.zeros(len(area)), where=area > 0)
