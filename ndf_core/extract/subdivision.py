"""The mesh under refinement: a triangulation of the base mesh and the mapped position of each of its vertices."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.asset.content import AssetContent
from ndf_core.asset.fields import FieldEvaluator
from ndf_core.errors import ExtractionError
from ndf_core.kernels.mesh_check import check_mesh, measure_mesh
from ndf_core.kernels.subdivide import (
    BasePoints,
    Triangulation,
    flip_edges,
    mark_long_edges,
    place_midpoints,
    split_faces,
)

MAX_VERTICES = 20_000_000
"""Largest mesh that is extracted; it takes about 6 GB on the way."""
MAX_ROUNDS = 48
"""Halving an edge more often than this leaves the range where weights are exact."""
FLIP_SWEEPS = 3
FLIP_ROUNDS = 12
"""Rounds of splitting in which edges are flipped too; after them flips may not undo what splitting needs to end."""

_LIKELY = 2.0
"""Vertices times edge length squared over area: 2.3 to 3.3 in practice, 1.15 at the very least."""
_SAFE = 4.0
"""The same, for the edge length that an error recommends."""


class Subdivision:
    """Conforming subdivision of a base mesh. Lengths are in the box frame.

    A vertex is a base point, so that every field can be evaluated there. Faces never cross base edges, so that the
    triangulation stays one of the base mesh, flips included.

    Raises:
        ExtractionError: the base mesh is not an oriented manifold along its edges, or the field is not finite.
    """

    def __init__(self, content: AssetContent, displacement: FieldEvaluator, threads: int) -> None:
        self._displacement = displacement
        self._threads = threads
        self.seconds = {"map": 0.0, "subdivide": 0.0, "check": 0.0}
        with self._stage("subdivide"):
            corners, used = _compact(content.faces, len(content.vertices))
            check = check_mesh(corners, used)
            if check.non_manifold_edges or check.inconsistent_edges or check.degenerate_faces:
                raise ExtractionError(
                    f"the asset's base mesh is not an oriented manifold: {check.non_manifold_edges} edges of more "
                    f"than two faces, {check.inconsistent_edges} of two that disagree, {check.degenerate_faces} "
                    f"degenerate faces; fit the surface again"
                )
            home = np.arange(len(corners), dtype=np.int32)
            self.mesh = Triangulation(corners, check.twins, home)
            faces, weights = _vertices_of(corners, used)
            self.points = BasePoints(np.ascontiguousarray(content.faces, dtype=np.int32), faces, weights)
            self._base_vertices = content.vertices
            self.base = self._positions(faces, weights)
        self.mapped = self._map(faces, weights)

    def refine(self, limit: float) -> None:
        """Split until no mapped edge is longer than `limit`, flipping edges towards Delaunay on the way.

        Raises:
            ExtractionError: this would take more than `MAX_VERTICES` vertices; or the field is so rough that edges do
                not get shorter.
        """
        self._refuse_too_fine(limit)
        for turn in range(MAX_ROUNDS):
            with self._stage("subdivide"):
                if turn < FLIP_ROUNDS:
                    flip_edges(self.mesh, self.mapped, self.points, limit, FLIP_SWEEPS)
                midpoint, count = mark_long_edges(self.mesh, self.mapped, self.base, limit)
                if not count:
                    return
                if len(self.mapped) + count > MAX_VERTICES:
                    raise TooFineError(max(self._recommended(), 1.5 * limit))
                faces, weights = place_midpoints(self.mesh, midpoint, count, self.points)
            mapped = self._map(faces, weights)
            with self._stage("subdivide"):
                self.mapped = np.concatenate([self.mapped, mapped])
                self.base = np.concatenate([self.base, self._positions(faces, weights)])
                self.points = BasePoints(
                    self.points.base_faces,
                    np.concatenate([self.points.faces, faces]),
                    np.concatenate([self.points.barycentric, weights]),
                )
                self.mesh = split_faces(self.mesh, midpoint, self.mapped)
            self._refuse_too_fine(limit)
        raise ExtractionError(
            f"the asset's field is so rough that {MAX_ROUNDS} halvings leave edges that are too long; the asset is "
            f"damaged, or its fit diverged"
        )

    def statistics(self, others: dict[str, float]) -> dict[str, object]:
        """Facts about the mesh as it is now, checked from its faces alone; `others`: seconds of more stages."""
        with self._stage("check"):
            check = check_mesh(self.mesh.corners, len(self.mapped))
            shape = measure_mesh(self.mapped, self.mesh.corners, check.twins)
        seconds = self.seconds | others
        return {
            "manifold": check.manifold,
            "closed": check.closed,
            "euler_characteristic": check.euler_characteristic,
            "delaunay_extrinsic": shape.delaunay,
            "folded_area": shape.folded_area,
            "seconds": {**seconds, "total": sum(seconds.values())},
        }

    def _map(self, faces: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        with self._stage("map"):
            mapped = self._displacement.at_base(faces, weights, self._threads).astype(np.float64)
        if not np.isfinite(mapped).all():
            raise ExtractionError("the asset's field is not finite; the asset is damaged, or its fit diverged")
        return mapped

    def _positions(self, faces: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Points on the base mesh itself."""
        return np.einsum("nk,nkc->nc", weights, self._base_vertices[self.points.base_faces[faces]])

    def _refuse_too_fine(self, limit: float) -> None:
        """Estimate the size from the area that is known by now, before anything is allocated for it."""
        with self._stage("subdivide"):
            if _LIKELY * self._area() > MAX_VERTICES * limit * limit:
                raise TooFineError(self._recommended())

    def _recommended(self) -> float:
        return (_SAFE * self._area() / MAX_VERTICES) ** 0.5

    def _area(self) -> float:
        return measure_mesh(self.mapped, self.mesh.corners, self.mesh.twins).area

    @contextmanager
    def _stage(self, name: str) -> Generator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - start


class TooFineError(ExtractionError):
    """More vertices than `MAX_VERTICES` would be needed; `smallest` is an edge length (box frame) that should do."""

    def __init__(self, smallest: float) -> None:
        super().__init__(f"more than {MAX_VERTICES} vertices would be needed")
        self.smallest = smallest


def _compact(faces: Int[Array, "f 3"], vertices: int) -> tuple[Int[Array, "f 3"], int]:
    """Faces with the vertices that they use numbered from 0, and how many there are."""
    used = np.zeros(vertices, dtype=bool)
    used[faces] = True
    return (np.cumsum(used) - 1)[faces].astype(np.int32), int(used.sum())


def _vertices_of(corners: Int[Array, "f 3"], count: int) -> tuple[Int[Array, " n"], Float[Array, "n 3"]]:
    """Each vertex as a base point: a face that it is a corner of, and weight 1 there."""
    faces = np.empty(count, dtype=np.int32)
    weights = np.zeros((count, 3))
    face = np.arange(len(corners), dtype=np.int32)
    for i in range(3):
        faces[corners[:, i]] = face
    weights[corners[faces] == np.arange(count)[:, None]] = 1.0
    return faces, weights
