"""Logarithmic map and parallel transport by the vector heat method (potpourri3d)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.mesh import face_normals
from ndf_core.processing.operators import Operators

_THINNEST = 1e-10
"""Height of a triangle over its longest side."""


class VectorHeat:
    """Solves for any sources after one factorisation. Sources are vertices: the ones closest to the points given.

    Vectors in and out are vectors in space, tangent to the surface.

    Reference: Sharp, Soliman, Crane 2019, The Vector Heat Method.
    """

    def __init__(self, operators: Operators) -> None:
        """Keep the mesh; it is factorised when first needed.

        Raises:
            InputError: the mesh has more than one component, between which nothing can be transported, or triangles
                without area, which potpourri3d does not survive.
        """
        if operators.components.max() > 0:
            raise InputError(
                f"the mesh has {int(operators.components.max()) + 1} components; directions are transported on one"
            )
        sides = operators.vertices[operators.faces] - operators.vertices[np.roll(operators.faces, -1, axis=1)]
        longest = (sides**2).sum(axis=2).max(axis=1)
        heights = np.linalg.norm(face_normals(operators.vertices, operators.faces), axis=1)
        thin = int((heights <= _THINNEST * longest).sum())
        if thin:
            raise InputError(f"{thin:,} triangles have no area: the logarithmic map needs a mesh without such")
        self._operators = operators

    def nearest_vertices(self, points: Float[Array, "n 3"] | Sequence[Sequence[float]]) -> Int[Array, " n"]:
        """The corner of the closest triangle that has the largest weight there.

        Raises:
            InputError: a point is not finite.
        """
        found = self._operators.closest(np.asarray(points, dtype=np.float64))
        rows = np.arange(len(found.faces))
        return self._operators.faces[found.faces][rows, found.barycentric.argmax(axis=1)].astype(np.int64)

    def log_map(self, vertex: int) -> Float[Array, "v 2"]:
        """Coordinates of every vertex as seen from one: its distance, in the direction in which one sets out for it.

        x along the vertex's own tangent (`tangents(...)[0]`). Exact in the plane; beyond the cut locus, and within a
        few edges of it, it means nothing.
        """
        return np.asarray(self._solver.compute_log_map(vertex), dtype=np.float64)

    def transport(self, vertices: Int[Array, " n"], vectors: Float[Array, "n 3"]) -> Float[Array, "v 3"]:
        """Tangent vectors of some vertices transported to all, each from its closest source.

        Raises:
            InputError: there is no vector.
        """
        if not len(vertices):
            raise InputError("transport: need at least one vector")
        first, second = self.tangents
        flat = np.stack([(vectors * first[vertices]).sum(1), (vectors * second[vertices]).sum(1)], axis=1)
        moved = np.asarray(self._solver.transport_tangent_vectors(vertices.tolist(), flat), dtype=np.float64)
        return moved[:, :1] * first + moved[:, 1:] * second

    @cached_property
    def tangents(self) -> tuple[Float[Array, "v 3"], Float[Array, "v 3"]]:
        """The two unit tangents of each vertex that coordinates are along."""
        first, second, _ = self._solver.get_tangent_frames()
        return np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)

    @cached_property
    def _solver(self):  # potpourri3d has no types
        from potpourri3d import MeshVectorHeatSolver

        try:
            return MeshVectorHeatSolver(self._operators.vertices, self._operators.faces)
        except (RuntimeError, ValueError) as error:
            raise InputError(f"the vector heat method needs a manifold mesh: {error}") from error
