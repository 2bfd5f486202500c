"""The triangles of a file as they can be worked with: distinct, finite, with vertices shared where they coincide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.mesh import face_normals
from ndf_core.readers.polygons import RawMesh
from ndf_core.surfaces.edges import Edges
from ndf_core.surfaces.welding import weld

_LARGEST = 1e60
_FLAT = 1e-14
"""Triangles with less area, as a share of the size squared, have no normal."""


@dataclass(frozen=True)
class Triangles:
    """At least one triangle; each with area."""

    vertices: Float[Array, "v 3"]
    """float64, input units."""
    faces: Int[Array, "f 3"]
    """int64."""
    notes: tuple[str, ...]

    @property
    def size(self) -> float:
        """Longest side of the bounding box."""
        return float(np.ptp(self.vertices[np.unique(self.faces)], axis=0).max())

    @property
    def area_vectors(self) -> Float[Array, "f 3"]:
        """Normals of length twice the area."""
        return face_normals(self.vertices, self.faces)

    @property
    def open_edges(self) -> Bool[Array, "f 3"]:
        """Whether the edge from corner i to the next has another number of triangles than two."""
        edges = Edges.of(self.faces, len(self.vertices))
        found = np.empty(3 * len(self.faces), dtype=bool)
        found[edges.order] = np.repeat(edges.uses != 2, edges.uses)
        return found.reshape(-1, 3)

    def sample(
        self, count: int, rng: np.random.Generator
    ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"], Int[Array, " n"]]:
        """Points even by area (a stratum of equal area for each), unit normals there, and their faces."""
        vectors = self.area_vectors
        areas = np.linalg.norm(vectors, axis=1)
        ends = np.cumsum(areas)
        ticks = (np.arange(count) + rng.random(count)) / count * ends[-1]
        face = np.minimum(np.searchsorted(ends, ticks), len(areas) - 1)
        root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
        a, b, c = (self.vertices[self.faces[face, k]] for k in range(3))
        points = (1 - root) * a + root * (1 - along) * b + root * along * c
        return points, vectors[face] / areas[face, None], face


def usable_triangles(raw: RawMesh, origin: str) -> Triangles:
    """Merge vertices at the same place and drop what is no triangle.

    Raises:
        InputError: an index is out of range, or no triangle with finite corners and area is left.
    """
    notes, vertices, faces = list(raw.notes), raw.vertices, raw.faces
    wrong = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if wrong.any():
        row = int(wrong.argmax())
        raise InputError(
            f"{origin}: {int(wrong.sum()):,} of {len(faces):,} triangles name vertices that do not exist, first "
            f"triangle {row} (counted from 0), {faces[row].tolist()}, of {len(vertices):,} vertices"
        )
    finite = np.asarray((np.abs(vertices) < _LARGEST).all(axis=1))[faces].all(axis=1)
    if not finite.all():
        notes.append(f"{int((~finite).sum()):,} triangles without finite corners left out")
    used, corners = np.unique(faces[finite], return_inverse=True)
    if not len(used):
        raise InputError(f"{origin}: has no triangle with finite corners")
    vertices = np.ascontiguousarray(vertices[used], dtype=np.float64)
    vertices, faces, merged = weld(vertices, corners.reshape(-1, 3), 0.0)
    notes += merged
    size = float(np.ptp(vertices, axis=0).max())
    flat = np.linalg.norm(face_normals(vertices, faces), axis=1) <= _FLAT * size**2
    if flat.any():
        notes.append(f"{int(flat.sum()):,} triangles without area left out")
    if flat.all():
        raise InputError(f"{origin}: all its triangles are degenerate: none has an area")
    return Triangles(vertices, faces[~flat].astype(np.int64), tuple(notes))
