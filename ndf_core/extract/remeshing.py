"""The mesh under refinement: an intrinsic triangulation of the base mesh and the mapped position of each vertex."""

from __future__ import annotations

import math
import time
from collections.abc import Generator
from contextlib import contextmanager

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.asset.content import AssetContent
from ndf_core.asset.fields import FieldEvaluator
from ndf_core.errors import ExtractionError
from ndf_core.kernels.mesh_check import check_mesh
from ndf_core.kernels.remesh import BasePoints, FlipAim, MappedTriangulation, RemeshKernel

MAX_VERTICES = 20_000_000
"""Largest mesh that is extracted; it takes about 13 GB on the way."""
STEP = 0.7
"""Limits of successive splits shrink by this at most, so that long edges are halved before shorter ones."""
SHORT = 0.25
"""Vertices of edges shorter than this share of the limit are removed (Sec. 3.4)."""
TOLERANCE = 0.01
"""Share of the limit by which a flip or a move may take the mesh farther from the surface."""
DELAUNAY_SHARE = 0.985
"""Of the exported edges; where the tolerance leaves fewer, larger ones follow."""
DELAUNAY_TOLERANCES = (TOLERANCE, 0.04, math.inf)
FLIP_ROUNDS = 3
"""Times that edges are held, and tried again with their middles, in one pass of flips."""
UNFOLD_EDITS = 4
UNFOLD_ROUNDS = 4
"""Times that edges at folds are halved."""
MOST_UNFOLDING = 0.1
"""Vertices that this may add, over those that there are."""
STEADY_ROUNDS = 3
"""Rounds of splitting at one limit until `STALLED` is looked at."""
STALLED = 0.7
"""Edges to be split, over those of the round before, from which flips no longer serve the mapped mesh."""
MAX_ROUNDS = 64
"""Halving an edge more often than this leaves the range where lengths mean anything."""

_LIKELY = 2.0
"""Vertices times edge length squared over area: 2.7 to 3 in practice, 1.15 at the very least."""
_SAFE = 4.5
"""The same, for the edge length that an error recommends."""
_SORT = 1.5
"""Sort again when there are this many times the vertices of the last time."""


class Remeshing:
    """The loop of Sec. 3.4 over a base mesh and a field. Lengths are in the box frame.

    Laws: the mesh is closed and manifold wherever the base mesh is, with its topology; no edge is longer than the
    limit (but for `unsplit_edges`).

    Raises:
        ExtractionError: the base mesh is not an oriented manifold, or the field is not finite.
    """

    def __init__(self, content: AssetContent, displacement: FieldEvaluator, threads: int) -> None:
        self._displacement = displacement
        self._threads = threads
        stages: list[str] = ["map", "split", "flip", "remove", "move", "sort", "measure"]
        self.seconds = dict.fromkeys(stages, 0.0)
        self.unsplit_edges = 0
        used = np.unique(content.faces)
        faces = np.searchsorted(used, content.faces).astype(np.int32)
        check = check_mesh(faces, len(used))
        if not check.manifold:
            raise ExtractionError(
                f"the asset's base mesh is not an oriented manifold: {check.non_manifold_edges} edges of more than "
                f"two faces, {check.inconsistent_edges} of two that disagree, {check.degenerate_faces} degenerate "
                f"faces, {check.non_manifold_vertices} vertices where surfaces touch; fit the surface again"
            )
        mapped = self._map(_corners(faces, len(used)))
        try:
            self._kernel = RemeshKernel(content.placed[used], faces, check.twins, mapped)
        except ValueError as error:
            raise ExtractionError(f"the asset's base mesh cannot be used: {error}; the asset is damaged") from error
        self._sorted = len(used)

    def refine(self, limit: float) -> MappedTriangulation:
        """Go on until no edge is longer than `limit` and the faces are as even as can be.

        Raises:
            ExtractionError: this would take more than `MAX_VERTICES` vertices.
        """
        self._refuse_too_fine(limit)
        tolerance = TOLERANCE * limit
        self._split(limit)
        with self._stage("remove"):
            self._kernel.remove_short_edges(SHORT * limit)
        self._flip(FlipAim.LOWER_ENERGY, limit, tolerance)
        self._move(math.inf, tolerance)
        self._flip(FlipAim.LOWER_ENERGY, limit, tolerance)
        self._split(limit)
        self._flip_to_delaunay(limit)
        self._unfold(limit)
        with self._stage("split"):
            longer, unsplit = self._kernel.find_long_edges(limit)
        self.unsplit_edges = unsplit + len(longer.faces)
        with self._stage("sort"):
            return self._kernel.triangulation()

    def edge_lengths(self) -> Float[Array, "f 3"]:
        """Of the half-edges along the surface, for the triangulation that `refine` gave last."""
        mapping = self.seconds["map"]
        with self._stage("measure"):
            lengths = self._kernel.edge_lengths(self._map)
        self.seconds["measure"] -= self.seconds["map"] - mapping
        return lengths

    def _split(self, limit: float) -> None:
        """Halve edges until none is longer than `limit`, the longest first, and flip after every round.

        Where the ends of edges meet though the surface between them is elsewhere, halves are no shorter, and flips
        that shorten edges bring back what was split. So when rounds at the limit stall, flips spread edges evenly on
        the base mesh instead.
        """
        step, rounds, stalled, before = self._kernel.measure()[1], 0, False, math.inf
        while rounds < MAX_ROUNDS:
            step = max(limit, STEP * step)
            rounds = rounds + 1 if step == limit else 0
            with self._stage("split"):
                middles, _ = self._kernel.find_long_edges(step, along=stalled)
            count = len(middles.faces)
            if self._kernel.vertex_count + count > MAX_VERTICES:
                raise TooFineError(max(self._recommended(), 1.5 * limit))
            mapped = self._map(middles)
            with self._stage("split"):
                refused = self._kernel.split(mapped)
            if step == limit and count == refused:
                return
            if self._kernel.vertex_count > _SORT * self._sorted:
                with self._stage("sort"):
                    self._kernel.sort()
                self._sorted = self._kernel.vertex_count
                self._refuse_too_fine(limit)
            stalled = stalled or (rounds > STEADY_ROUNDS and count > STALLED * before)
            before = count
            if stalled:
                self._flip(FlipAim.SPREAD, step)
            else:
                self._flip(FlipAim.LOWER_ENERGY, step, TOLERANCE * limit)

    def _flip(self, aim: FlipAim, limit: float, tolerance: float = math.inf) -> int:
        """Flip edges, those that would move the surface by more than `tolerance` only where the map says they may."""
        with self._stage("flip"):
            flips, middles = self._kernel.flip(aim, limit, tolerance)
        for _ in range(FLIP_ROUNDS):
            if not len(middles.faces):
                break
            mapped = self._map(middles)
            with self._stage("flip"):
                more, middles = self._kernel.flip_held(mapped)
            flips += more
        return flips

    def _flip_to_delaunay(self, limit: float) -> None:
        """Flip with as small a tolerance as leaves enough edges Delaunay."""
        for tolerance in DELAUNAY_TOLERANCES:
            self._flip(FlipAim.DELAUNAY, limit, tolerance * limit)
            with self._stage("flip"):
                if self._kernel.delaunay_share() >= DELAUNAY_SHARE:
                    return

    def _unfold(self, limit: float) -> None:
        """Flip edges and move vertices where faces lie folded over each other; halve edges there if some are left.

        Faces that are larger than a surface's detail fold where the surface does not. But a blade is as sharp between
        halves as before, so vertices are added only up to a share.
        """
        self._unfold_by_edits(limit)
        before = self._kernel.vertex_count
        most = (1 + MOST_UNFOLDING) * before
        for _ in range(UNFOLD_ROUNDS):
            with self._stage("split"):
                middles = self._kernel.find_folded_edges()
            if not 0 < len(middles.faces) <= most - self._kernel.vertex_count:
                break
            mapped = self._map(middles)
            with self._stage("split"):
                self._kernel.split(mapped)
                longer, _ = self._kernel.find_long_edges(limit)
            if len(longer.faces):
                self._split(limit)
            self._flip_to_delaunay(limit)
            self._unfold_by_edits(limit)
        if self._kernel.vertex_count > before:
            self._flip_to_delaunay(limit)

    def _unfold_by_edits(self, limit: float) -> None:
        for _ in range(UNFOLD_EDITS):
            flips = self._flip(FlipAim.UNFOLD, limit)
            if not self._move(limit, math.inf, folded=True) and not flips:
                return

    def _move(self, limit: float, tolerance: float, folded: bool = False) -> int:
        with self._stage("move"):
            centres = self._kernel.find_moves(limit, tolerance, folded)
        mapped = self._map(centres)
        with self._stage("move"):
            return self._kernel.move(mapped)

    def _map(self, points: BasePoints) -> Float[Array, "n 3"]:
        with self._stage("map"):
            mapped = self._displacement.at_base(*points, self._threads).astype(np.float64)
        if not np.isfinite(mapped).all():
            raise ExtractionError("the asset's field is not finite; the asset is damaged, or its fit diverged")
        return mapped

    def _refuse_too_fine(self, limit: float) -> None:
        """Estimate the size from the area that is known by now, before anything is allocated for it."""
        if _LIKELY * self._kernel.measure()[0] > MAX_VERTICES * limit * limit:
            raise TooFineError(self._recommended())

    def _recommended(self) -> float:
        return (_SAFE * self._kernel.measure()[0] / MAX_VERTICES) ** 0.5

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


def _corners(faces: Int[Array, "f 3"], count: int) -> BasePoints:
    """Each vertex as a base point: a face that it is a corner of, and weight 1 there."""
    home, weights = np.empty(count, dtype=np.int32), np.zeros((count, 3))
    for i in range(3):
        home[faces[:, i]] = np.arange(len(faces), dtype=np.int32)
    weights[faces[home] == np.arange(count)[:, None]] = 1.0
    return BasePoints(home, weights)
