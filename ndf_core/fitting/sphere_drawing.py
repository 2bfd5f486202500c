"""A closed mesh of genus 0, drawn on the unit sphere so that no triangle is turned over and few are much distorted.

Vertices leave by half-edge collapses, the shortest edges first, until four are left: a tetrahedron. They come back in
the opposite order, each to where it sees all of its ring. There is such a place, since the ring was a fan from one of
its vertices before; so nothing ever folds. Now and then all vertices move to where the distortion is less.

Reference: spherical parametrisation from coarse to fine, Praun and Hoppe 2003.
"""

from __future__ import annotations

import heapq
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.errors import FitError
from ndf_core.fitting.registration import nearest_rotation
from ndf_core.fitting.sphere_distortion import Distortion, Metric, sphere_sized
from ndf_core.mesh import unit

_TETRAHEDRON = 4
_CORNERS = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
_COARSE = 250
_MOST_NEIGHBOURS = 12
_FEW = 300
"""Drawings of fewer vertices are smoothed for longer: it costs nothing, and settles how the whole lies."""
_GROWTH = 1.2
"""Vertices are moved each time that there are this many more."""
_SWEEPS = 10
_TRIED = 40
_LED = 0.08
"""Radians that led vertices move at once, and all others with them as far as they are near ..."""
_NEAR = 0.5
"""... the standard deviation of the Gaussian."""
_LEADING_STEPS = 200


class _Collapse(NamedTuple):
    """`vertex` went into ring[0]; its ring is in order, counterclockwise from outside."""

    vertex: int
    ring: list[int]


class SphereDrawing:
    """The mesh while it is being drawn."""

    def __init__(
        self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], kept: Int[Array, " k"] | None = None
    ) -> None:
        """Take the mesh apart down to a tetrahedron, and draw that.

        Args:
            vertices, faces: closed, connected, of genus 0, outwards.
            kept: vertices that are among the first `coarse` to come back.

        Raises:
            FitError: the mesh is another one.
        """
        self._vertices = sphere_sized(vertices, faces)
        self._next: list[dict[int, int]] = [{} for _ in vertices]
        """For each vertex a: c by b, for its triangles (a, b, c)."""
        for a, b, c in faces.tolist():
            self._next[a][b], self._next[b][c], self._next[c][a] = c, a, b
        self._gone: list[_Collapse] = []
        first = set[int]() if kept is None else set(kept.tolist())
        self.coarse = min(len(vertices), max(_COARSE, 3 * len(first)))
        self._take_away(self.coarse, first)
        self._take_away(_TETRAHEDRON, set())
        left = [vertex for vertex, around in enumerate(self._next) if around]
        if len(left) != _TETRAHEDRON:
            raise FitError("only a closed mesh of genus 0 can be drawn on a sphere")
        self.positions = np.zeros_like(self._vertices)
        """Unit vectors; zero for vertices that have not come back."""
        self.positions[left] = _CORNERS
        if not self._distortion(None).valid(self.positions):
            self.positions[left] = -_CORNERS

    @property
    def count(self) -> int:
        """Vertices that are drawn."""
        return len(self._next) - len(self._gone)

    def grow(self, count: int, fixed: Bool[Array, " v"] | None = None, metric: Metric | None = None) -> None:
        """Draw vertices that have not come back until there are `count`.

        Args:
            count: of all.
            fixed: vertices that stay where they are.
            metric: of another surface, which is to be covered evenly; otherwise the sphere is.

        Raises:
            FitError: the mesh is too degenerate to be drawn.
        """
        smooth_at = self.count
        while self.count < count:
            self._bring_back(self._gone.pop())
            if self.count >= smooth_at or self.count == count:
                few = self.count < _FEW
                self._smooth((4 if few else 1 + (self.count == count)) * _SWEEPS, fixed, metric)
                smooth_at = max(self.count + 1, int(_GROWTH * self.count))

    def lead(self, chosen: Int[Array, " k"], goals: Float[Array, "k 3"]) -> None:
        """Move vertices to places on the sphere in small steps, after the turn of the whole that brings them nearest.

        Raises:
            FitError: they cannot be reached without turning a triangle over.
        """
        fixed = np.zeros(len(self._next), dtype=bool)
        fixed[chosen] = True
        distortion, drawn = self._distortion(fixed), np.flatnonzero(self.positions.any(axis=1))
        self.positions = self.positions @ nearest_rotation(self.positions[chosen], goals)
        for _ in range(_LEADING_STEPS):
            way = ways(self.positions[chosen], goals)
            length = np.linalg.norm(way, axis=1, keepdims=True)
            if length.max() < 1e-4:
                return
            way *= np.minimum(1.0, _LED / np.maximum(length, 1e-12))
            for width, share in product((_NEAR, _NEAR / 2, _NEAR / 4), (1.0, 0.5, 0.25, 0.12, 0.06)):
                moved = self.positions.copy()
                moved[drawn] = dragged(moved[drawn], moved[chosen], share * way, width)
                if distortion.valid(moved):
                    self.positions = moved
                    break
            distortion.lower(self.positions, 4)
        raise FitError("the anchors cannot all be reached without folds: some of them contradict each other")

    def _smooth(self, sweeps: int, fixed: Bool[Array, " v"] | None, metric: Metric | None) -> None:
        distortion = self._distortion(fixed)
        for start in range(0, sweeps, _SWEEPS // 2):
            if metric is not None:
                distortion.use(metric, self.positions)
            distortion.lower(self.positions, min(_SWEEPS // 2, sweeps - start))

    def _distortion(self, fixed: Bool[Array, " v"] | None) -> Distortion:
        corners = [(a, b, c) for a, around in enumerate(self._next) for b, c in around.items()]
        return Distortion(self._vertices, np.array(corners), fixed)

    def _take_away(self, until: int, kept: set[int]) -> None:
        """Collapse vertices that are not `kept` until so many are left, or none can go."""
        most = _MOST_NEIGHBOURS
        while self.count > until and most <= len(self._next) + _MOST_NEIGHBOURS:
            before = self.count
            heap = [
                (self._length(vertex, other), vertex, other)
                for vertex, around in enumerate(self._next)
                if vertex not in kept
                for other in around
            ]
            heapq.heapify(heap)
            while heap and self.count > until:
                _, vertex, other = heapq.heappop(heap)
                if other not in self._next[vertex] or not self._may_collapse(vertex, other, most):
                    continue
                for near in self._collapse(vertex, other).ring[1:]:
                    length = self._length(other, near)
                    for pair in ((other, near), (near, other)):
                        if pair[0] not in kept:
                            heapq.heappush(heap, (length, *pair))
            if self.count == before:
                most *= 2

    def _length(self, a: int, b: int) -> float:
        side = self._vertices[a] - self._vertices[b]
        return float(side @ side)

    def _may_collapse(self, vertex: int, other: int, most: int) -> bool:
        """The result is a manifold (link condition), and no vertex gets too many neighbours."""
        around, beside = self._next[vertex], self._next[other]
        return len(around) + len(beside) - 4 <= most and sum(near in beside for near in around) == 2

    def _collapse(self, vertex: int, other: int) -> _Collapse:
        ring, near = [other], self._next[vertex][other]
        while near != other:
            ring.append(near)
            near = self._next[vertex][near]
        right, left = ring[1], ring[-1]
        for a, b in ((other, right), (right, vertex), (left, other), (other, vertex)):
            del self._next[a][b]
        for a, b in pairwise(ring[1:]):
            del self._next[b][vertex]
            self._next[other][a], self._next[a][b], self._next[b][other] = b, other, a
        self._next[vertex] = {}
        self._gone.append(_Collapse(vertex, ring))
        return self._gone[-1]

    def _bring_back(self, collapse: _Collapse) -> None:
        vertex, ring = collapse
        self.positions[vertex] = _sees(self.positions[ring])
        other = ring[0]
        for a, b in pairwise(ring[1:]):
            del self._next[other][a], self._next[b][other]
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            self._next[vertex][a], self._next[a][b], self._next[b][vertex] = b, vertex, a


def _sees(ring: Float[Array, "k 3"]) -> Float[Array, "3"]:
    """A place from which all sides of a ring on the sphere are seen from within: near ring[0] there is one.

    Raises:
        FitError: not with the precision that numbers have.
    """
    walls = unit(np.cross(ring, np.roll(ring, -1, axis=0)))
    corner = ring[0]
    ahead, back = (unit(side - (side @ corner) * corner) for side in (ring[1], ring[-1]))
    across = np.cross(corner, ahead)
    angle = (np.arctan2(back @ across, back @ ahead) % (2 * np.pi)) / 2
    inwards = np.cos(angle) * ahead + np.sin(angle) * across
    reach = np.linalg.norm(ring[1:] - corner, axis=1).max()
    best, clearance = unit(ring.sum(axis=0)), 0.0
    clearance = float((walls @ best).min())
    for _ in range(_TRIED):
        tried = unit(corner + reach * inwards)
        found = float((walls @ tried).min())
        if found > clearance:
            best, clearance = tried, found
        elif clearance > 0:
            break
        reach *= 0.6
    step = max(clearance, 0.05)
    for _ in range(_TRIED):  # away from the nearest wall
        tried = unit(best + step * walls[(walls @ best).argmin()])
        found = float((walls @ tried).min())
        if found > clearance:
            best, clearance = tried, found
        else:
            step *= 0.6
    if not clearance > 0:
        raise FitError("the mesh is too degenerate to be drawn on a sphere")
    return best


def dragged(
    points: Float[Array, "n 3"], starts: Float[Array, "k 3"], ways: Float[Array, "k 3"], width: float
) -> Float[Array, "n 3"]:
    """Points of the sphere, moved smoothly so that what is at `starts` goes the given small ways along the sphere."""

    def near(places: Float[Array, "m 3"]) -> Float[Array, "m k"]:
        return np.exp(-((places[:, None] - starts) ** 2).sum(axis=2) / (2 * width**2))

    motion = near(points) @ np.linalg.solve(near(starts) + 1e-6 * np.eye(len(starts)), ways)
    return unit(points + motion - (motion * points).sum(axis=1, keepdims=True) * points)


def ways(points: Float[Array, "k 3"], goals: Float[Array, "k 3"]) -> Float[Array, "k 3"]:
    """Along the sphere: directions times angles."""
    across = goals - (goals * points).sum(axis=1, keepdims=True) * points
    angle = np.arctan2(np.linalg.norm(across, axis=1), (goals * points).sum(axis=1))
    return unit(across) * angle[:, None]
