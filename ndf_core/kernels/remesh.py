"""Remeshing of a map from a base mesh by intrinsic triangulations of that mesh: the interface of `src/remesh.c`."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.kernels import _remesh  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub

_FACES_AT_A_TIME = 1 << 17
"""Edges are measured in so many faces at once; memory that is used again costs less than new memory."""


class BasePoints(NamedTuple):
    """Points of a base mesh."""

    faces: Int[Array, " n"]
    """int32; for a point on a base edge, either of its two."""
    barycentric: Float[Array, "n 3"]
    """float64, exactly zero on an edge of the face."""


class MappedTriangulation(NamedTuple):
    """A triangulation of a base mesh and where its vertices are mapped to."""

    faces: Int[Array, "f 3"]
    """int32."""
    points: BasePoints
    mapped: Float[Array, "v 3"]
    """float64."""


class HalfEdges(NamedTuple):
    """The edges of a triangulation as straight lines on the base mesh. Half-edge 3 f + i starts at corner i of f."""

    twins: Int[Array, "f 3"]
    """int32: the half-edge on the other side, -1 at a border."""
    homes: Int[Array, "f 3"]
    """int32: the base face in whose plane the vector is given."""
    vectors: Float[Array, "f 3 2"]
    """float64: from start to end, unfolded; the first edge of a base face is the x axis of its plane."""


class FlipAim(IntEnum):
    """What flips are for. None but `SPREAD` leaves a crease of more than 60 degrees sharper than it was."""

    LOWER_ENERGY = 0
    """A lower ODT energy: the sum over faces of area times squared edge lengths, in space."""
    DELAUNAY = 1
    """Opposite angles in space that add up to pi at most."""
    UNFOLD = 2
    """Where faces lie folded over each other, no edge left as sharp."""
    SPREAD = 3
    """Beside edges longer than the limit: opposite angles on the base mesh that add up to pi at most."""


class RemeshKernel:
    """A triangulation of a base mesh, its vertices mapped to space; at first the base mesh itself.

    Lengths in space, and only they, decide what is changed. Every change is one of the triangulation of the base mesh
    as an intrinsic surface, so that the map stays a bijection between the two, and the mesh simplicial: no loop, no
    double edge or face. The corners of the base mesh stay vertices.

    Laws: every edge is a straight line on the base mesh; topology and area of the base mesh stay; the same on every
    run.

    A pass that needs new points of the map answers with base points; the pass that uses them has to come next.

    Reference: Sharp, Soliman, Crane 2019 (signposts); sections 3.4 of the paper.
    """

    def __init__(
        self,
        vertices: Float[Array, "v 3"],
        faces: Int[Array, "b 3"],
        twins: Int[Array, "b 3"],
        mapped: Float[Array, "v 3"],
    ) -> None:
        """Take the base mesh as the first triangulation. `twins` are those of `check_mesh`; boundaries are allowed.

        Raises:
            ValueError: the faces are not an oriented manifold, some vertex is unused, or a position is not finite.
        """
        if not (np.isfinite(vertices).all() and np.isfinite(mapped).all()):
            raise ValueError("vertices: not finite")
        self._state = _remesh.create(
            np.ascontiguousarray(vertices, dtype=np.float64),
            np.ascontiguousarray(faces, dtype=np.int32),
            np.ascontiguousarray(twins, dtype=np.int32),
            np.ascontiguousarray(mapped, dtype=np.float64),
        )

    @property
    def vertex_count(self) -> int:
        return _remesh.size(self._state)[0]

    def measure(self) -> tuple[float, float]:
        """Area and longest edge of the mapped mesh."""
        return _remesh.measure(self._state)

    def find_long_edges(self, limit: float, along: bool = False) -> tuple[BasePoints, int]:
        """Middles of the edges that are mapped longer than `limit`, for `split`, and how many edges have none.

        Edges a million times shorter on the base mesh than its own are not split. With `along`, the longest edge of
        every thin face beside them is split too; then splitting again and again ends wherever the map is Lipschitz.
        """
        count, refused = _remesh.find_long(self._state, limit, along)
        return self._places(count), refused

    def find_folded_edges(self) -> BasePoints:
        """Middles of the longest edges of faces that lie folded over a neighbour, for `split`."""
        return self._places(_remesh.find_folded(self._state))

    def split(self, mapped: Float[Array, "n 3"]) -> int:
        """Put vertices at the places found last, which are mapped to `mapped`; the number that was refused."""
        return _remesh.split(self._state, np.ascontiguousarray(mapped, dtype=np.float64))[0]

    def find_moves(self, limit: float = math.inf, tolerance: float = math.inf, folded: bool = False) -> BasePoints:
        """For every vertex that was put on an edge, the centre of the faces around it, for `move`.

        Moves will leave no edge longer than `limit` at a vertex that moves, and take the mesh no farther than before
        from the surface where the vertex was, but for `tolerance`. With `folded`, only vertices beside edges whose
        faces lie folded over each other.
        """
        return self._places(_remesh.find_moves(self._state, folded, limit, tolerance))

    def move(self, mapped: Float[Array, "n 3"]) -> int:
        """Move vertices to the places found last wherever that makes no face worse; how many were moved."""
        return _remesh.move(self._state, np.ascontiguousarray(mapped, dtype=np.float64))[0]

    def remove_short_edges(self, limit: float) -> int:
        """Remove a vertex of each edge shorter than `limit`, though none of the base mesh; how many were removed."""
        return _remesh.remove_short(self._state, limit)

    def flip(self, aim: FlipAim, limit: float, tolerance: float = math.inf) -> tuple[int, BasePoints]:
        """Flip edges; how many, and what `flip_held` needs. No edge beyond `limit` replaces a shorter one.

        Edges whose flips would move the surface by more than `tolerance` are held. The answer has two points each:
        the middle of the edge and that of the one that would replace it.
        """
        flips, count = _remesh.flip(self._state, int(aim), limit, tolerance)
        return flips, self._places(count)

    def delaunay_share(self) -> float:
        """Of the inner edges, by their opposite angles in space."""
        return _remesh.delaunay(self._state)

    def flip_held(self, mapped: Float[Array, "n 3"]) -> tuple[int, BasePoints]:
        """Flip edges held whose replacements are no farther from the surface, but for the tolerance; as `flip`."""
        flips, count = _remesh.flip_held(self._state, np.ascontiguousarray(mapped, dtype=np.float64))
        return flips, self._places(count)

    def sort(self) -> None:
        """Renumber everything by its place on the base mesh; passes over large meshes are twice as fast for it."""
        _remesh.sort(self._state)

    def flip_edge(self, half_edge: int) -> bool:
        """Flip one edge, if it can be flipped on the base mesh."""
        return _remesh.edit(self._state, 0, half_edge)

    def remove_vertex(self, vertex: int) -> bool:
        """Remove one vertex, if it was put on an edge and edges can be flipped away from it."""
        return _remesh.edit(self._state, 1, vertex)

    def triangulation(self) -> MappedTriangulation:
        """A copy of the present state, sorted."""
        self.sort()
        vertices, faces = _remesh.size(self._state)
        result = MappedTriangulation(
            np.empty((faces, 3), np.int32),
            BasePoints(np.empty(vertices, np.int32), np.empty((vertices, 3))),
            np.empty((vertices, 3)),
        )
        _remesh.export(self._state, result.faces, *result.points, result.mapped)
        return result

    def edge_lengths(self, evaluate: Callable[[BasePoints], Float[Array, "n 3"]]) -> Float[Array, "f 3"]:
        """Lengths of the half-edges along the mapped surface, in the order of `triangulation`.

        Laws: an edge has one length, at least its straight one and at most 1.15 times that. Edges of faces that would
        be no triangles have their straight ones.

        Args:
            evaluate: The map. It is asked about the middles of the edges, some at a time.
        """
        self.sort()
        faces = _remesh.size(self._state)[1]
        lengths = np.empty((faces, 3))
        for first in range(0, faces, _FACES_AT_A_TIME):
            middles = self._places(_remesh.find_edges(self._state, first, min(first + _FACES_AT_A_TIME, faces)))
            mapped = np.ascontiguousarray(evaluate(middles), dtype=np.float64)
            _remesh.measure_edges(self._state, mapped, lengths)
        _remesh.keep_triangles(self._state, lengths)
        return lengths

    def half_edges(self) -> HalfEdges:
        """A copy of the edges, in the order of `triangulation`."""
        self.sort()
        shape = (_remesh.size(self._state)[1], 3)
        result = HalfEdges(np.empty(shape, np.int32), np.empty(shape, np.int32), np.empty((*shape, 2)))
        _remesh.edges(self._state, *result)
        return result

    def _places(self, count: int) -> BasePoints:
        points = BasePoints(np.empty(count, np.int32), np.empty((count, 3)))
        _remesh.places(self._state, *points)
        return points
