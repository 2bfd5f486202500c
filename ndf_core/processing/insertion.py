"""Points of a mesh made its vertices: faces and edges split where they lie, the surface unchanged."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.processing.surface_points import SurfacePoints

_SNAP = 1e-6
"""Weights below this count as zero: a sliver as thin as that is worse than a move by a millionth of an edge."""


def insert_points(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], points: SurfacePoints
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], Int[Array, " n"]]:
    """Split faces so that every point is a vertex.

    Args:
        vertices: Any units.
        faces: A manifold along its edges.
        points: On the mesh. Those within a millionth of an edge length of a vertex are taken to be it.

    Returns:
        All vertices, the old ones first; the new faces; and the vertex of each point.
    """
    state = _Splitting([*vertices], faces.tolist(), {})
    for face, position in zip(points.faces.tolist(), points.positions, strict=True):
        state.insert(face, position)
    return np.array(state.vertices), np.array(state.faces, dtype=np.int32), np.array(state.made, dtype=np.int64)


class _Splitting:
    """A mesh in Python lists, for the few splits that sources need."""

    def __init__(self, vertices: list[Array], faces: list[list[int]], pieces: dict[int, list[int]]) -> None:
        self.vertices, self.faces, self.pieces = vertices, faces, pieces
        self.made: list[int] = []

    def insert(self, face: int, position: Array) -> None:
        """`face` counts in the mesh before any split; the piece of it that holds the point is split."""
        candidates = [(piece, self._weights(piece, position)) for piece in self.pieces.get(face, [face])]
        piece, weights = max(candidates, key=lambda candidate: candidate[1].min())
        corners = self.faces[piece]
        near = weights > _SNAP
        if near.sum() == 1:
            self.made.append(corners[int(near.argmax())])
            return
        self.made.append(len(self.vertices))
        self.vertices.append(position)
        if near.all():
            self._split(piece, [[corners[i], corners[(i + 1) % 3], self.made[-1]] for i in range(3)])
            return
        opposite = int(near.argmin())
        edge = {corners[(opposite + 1) % 3], corners[(opposite + 2) % 3]}
        for other in [i for i, corner in enumerate(self.faces) if edge < set(corner)]:
            self._split_edge(other, edge, self.made[-1])

    def _split_edge(self, face: int, edge: set[int], middle: int) -> None:
        corners = self.faces[face]
        halves = [[middle if corner == end else corner for corner in corners] for end in edge]
        self._split(face, halves)

    def _split(self, face: int, parts: list[list[int]]) -> None:
        """The first part takes the face's place, the others come last."""
        owner = next((owner for owner, pieces in self.pieces.items() if face in pieces), face)
        numbers = [face, *range(len(self.faces), len(self.faces) + len(parts) - 1)]
        self.faces[face] = parts[0]
        self.faces.extend(parts[1:])
        self.pieces[owner] = sorted({*self.pieces.get(owner, []), *numbers})

    def _weights(self, face: int, position: Array) -> Array:
        """Barycentric weights of the projection onto the face's plane."""
        a, b, c = (self.vertices[corner] for corner in self.faces[face])
        normal = np.cross(b - a, c - a)
        square = float(normal @ normal)
        if square == 0:
            return np.full(3, -np.inf)
        second = float(np.cross(position - a, c - a) @ normal) / square
        third = float(np.cross(b - a, position - a) @ normal) / square
        return np.array([1 - second - third, second, third])
