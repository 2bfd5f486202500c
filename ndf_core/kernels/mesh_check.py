"""Facts about a triangle mesh in linear time: the interface of `src/mesh_check.c`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.kernels import _mesh_check  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub


class MeshCheck(NamedTuple):
    """What `check_mesh` counts; the same meanings as in `ndf_core.mesh.Topology`, which takes n log n and longer."""

    twins: Int[Array, "f 3"]
    """int32: half-edge 3 f + i runs from corner i to corner i + 1 of face f. The half-edge on its other side; -1 at a
    boundary, -2 where the edge is not manifold."""
    edges: int
    boundary_edges: int
    non_manifold_edges: int
    inconsistent_edges: int
    non_manifold_vertices: int
    used_vertices: int
    degenerate_faces: int
    unused_vertices: int

    @property
    def closed(self) -> bool:
        return self.boundary_edges == 0

    @property
    def manifold(self) -> bool:
        return not (
            self.non_manifold_edges
            or self.inconsistent_edges
            or self.non_manifold_vertices
            or self.degenerate_faces
            or self.unused_vertices
        )

    @property
    def euler_characteristic(self) -> int:
        return self.used_vertices - self.edges + len(self.twins)


class MeshShape(NamedTuple):
    """Measures of the embedded triangles."""

    delaunay: float
    """Share of the inner edges whose two opposite cotangents add up to at least -1e-6; 1 where there are none."""
    area: float
    folded_area: float
    """Share of the area in faces that have a neighbour folded over them (unit normals' product below -1/2)."""


def check_mesh(faces: Int[Array, "f 3"], vertex_count: int) -> MeshCheck:
    """Link the half-edges and count everything that is not manifold.

    Raises:
        IndexError: a face names a vertex that does not exist.
    """
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    twins = np.empty_like(corners)
    *counts, used, degenerate = _mesh_check.check(twins, corners, vertex_count)
    edges, boundary, crowded, inconsistent, singular = counts
    return MeshCheck(twins, edges, boundary, crowded, inconsistent, singular, used, degenerate, vertex_count - used)


def measure_mesh(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], twins: Int[Array, "f 3"]) -> MeshShape:
    """Delaunay edges, folds and area (units of `vertices`, squared); `twins` as `check_mesh` gives them."""
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    inner, delaunay, area, folded = _mesh_check.shape(points, np.ascontiguousarray(faces, dtype=np.int32), twins)
    return MeshShape(delaunay / inner if inner else 1.0, area, folded / area if area > 0 else 0.0)
