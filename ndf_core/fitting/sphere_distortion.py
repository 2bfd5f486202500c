"""How much a drawing of triangles on the unit sphere distorts them, and moving its vertices to where that is less.

The distortion of a triangle is its symmetric Dirichlet energy (Smith and Schaefer 2015), least where it is only
moved, and without bound as its area goes to zero: no move that lowers it turns a triangle over. The sum over all
triangles is of its square, so that few are much worse than the mean. Lengths on the sphere are its own, or those of
another surface that is drawn on the same sphere (`Metric`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals, unit

SPHERE = 4 * np.pi
_ROUNDED = 0.2
"""Of its longest squared side, added to each: coarse triangles of slender limbs would have no area otherwise."""
_FIRST = 8.0
"""Steps are tried from this multiple of Newton's down, each half of the one before ..."""
_TRIES = 11
"""... this many at most."""


class Metric:
    """Lengths on a surface, at the points of the sphere that it is drawn on. Its whole area counts as 4 pi."""

    def __init__(self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], drawn: Float[Array, "v 3"]) -> None:
        self._tree, self._faces = TriangleBVH(drawn, faces), faces
        surface, sphere = edge_columns(sphere_sized(vertices, faces), faces), edge_columns(drawn, faces)
        stretched = surface @ np.linalg.pinv(sphere)
        tensors = stretched.transpose(0, 2, 1) @ stretched
        weights = np.repeat(np.linalg.norm(face_normals(drawn, faces), axis=1), 3)
        self._tensors = np.zeros((len(vertices), 3, 3))
        np.add.at(self._tensors, faces.ravel(), np.repeat(tensors, 3, axis=0) * weights[:, None, None])
        self._tensors /= np.bincount(faces.ravel(), weights, len(vertices))[:, None, None]

    def at(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3 3"]:
        """Tensors G: a step d along the sphere is sqrt(d^T G d) long on the surface."""
        _, faces, weights = self._tree.closest(points)
        tensors = np.einsum("nc,ncij->nij", weights, self._tensors[self._faces[faces]])
        tangent = np.eye(3) - points[:, :, None] * points[:, None, :]
        return tangent @ tensors @ tangent


class Independent(NamedTuple):
    """Vertices of which no two share a triangle, and the corners around each of them."""

    vertices: Int[Array, " n"]
    corners: Int[Array, " c"]
    starts: Int[Array, " n"]
    owner: Int[Array, " c"]


class _Terms(NamedTuple):
    """What the distortion of triangles (a, b, c), and its slope at a, are made of."""

    energy: Float[Array, " n"]
    """Infinite where the triangle is turned over."""
    dirichlet: Float[Array, " n"]
    ratio: Float[Array, " n"]
    """The square of the triangle's area before over that where it is drawn, which is `area`."""
    area: Float[Array, " n"]
    area_slope: Float[Array, "n 3"]
    cotangents: Float[Array, "2 n"]
    """At b and c ..."""
    sides: Float[Array, "2 n 3"]
    """... and the sides opposite to them, towards a, by the metric."""


class Distortion:
    """Of one triangulation; all triangles together count as 4 pi."""

    def __init__(
        self, vertices: Float[Array, "v 3"], corners: Int[Array, "c 3"], fixed: Bool[Array, " v"] | None = None
    ) -> None:
        """Measure the triangles before they are drawn.

        Args:
            vertices: not drawn.
            corners: each triangle three times, once from each corner; in groups by the first corner.
            fixed: vertices that `lower` leaves where they are.
        """
        a, b, c = corners.T
        self._a, self._b, self._c = a, b, c
        ends = ((b, c), (c, a), (a, b))
        sides = np.stack([((vertices[p] - vertices[q]) ** 2).sum(axis=1) for p, q in ends])
        longest = sides.max(axis=0)
        sides = sides + _ROUNDED * np.maximum(longest, 1e-12 * longest.mean())
        products = sides[0] * sides[1] + sides[1] * sides[2] + sides[2] * sides[0]
        areas = np.sqrt(2 * products - (sides**2).sum(axis=0)) / 4
        self._cotangents = (sides.sum(axis=0) - 2 * sides) / (4 * areas)
        self._areas = areas * (3 * SPHERE / areas.sum())
        self._tensors: Float[Array, "c 3 3"] | None = None
        self._groups = list(independent(corners, fixed))

    def use(self, metric: Metric, drawn: Float[Array, "v 3"]) -> None:
        """Measure lengths by `metric`, as it is in the middles of the triangles where they are drawn now."""
        tensors = metric.at(unit(drawn[self._a] + drawn[self._b] + drawn[self._c]))
        trace = np.trace(tensors, axis1=1, axis2=2)
        self._tensors, self._trace = tensors, trace
        self._area_factor = np.sqrt(np.maximum((trace**2 - (tensors**2).sum(axis=(1, 2))) / 2, 1e-12))

    def valid(self, drawn: Float[Array, "v 3"]) -> bool:
        """No triangle is turned over."""
        crossed = np.cross(drawn[self._b], drawn[self._c])
        return bool(((crossed * drawn[self._a]).sum(axis=1) > 0).all())

    def lower(self, drawn: Float[Array, "v 3"], sweeps: int) -> None:
        """Move each vertex, in place, by its own approximate Newton step along the sphere, if it lowers the sum."""
        for _ in range(sweeps):
            for group in self._groups:
                self._move(drawn, group)

    def _move(self, drawn: Float[Array, "v 3"], group: Independent) -> None:
        here = drawn[group.vertices]
        terms = self._terms(drawn, group.corners, here[group.owner])
        energy = self._sum(terms, group)
        slope, curvature = self._slopes(terms, group)
        slope -= (slope * here).sum(axis=1, keepdims=True) * here
        step = -_FIRST * slope / curvature[:, None]
        best, least = here.copy(), energy.copy()
        for count in range(_TRIES):
            tried = here + step
            tried /= np.linalg.norm(tried, axis=1, keepdims=True)
            found = self._sum(self._terms(drawn, group.corners, tried[group.owner]), group)
            better = found < least
            best[better], least[better] = tried[better], found[better]
            if count > 3 and (least < energy).all():
                break
            step *= 0.5
        drawn[group.vertices] = best

    @no_type_check  # called tens of thousands of times, on few rows
    def _terms(self, drawn: Float[Array, "v 3"], corners: Int[Array, " n"], a: Float[Array, "n 3"]) -> _Terms:
        """Of triangles whose first corner is at `a`."""
        b, c = drawn[self._b[corners]], drawn[self._c[corners]]
        area_slope = np.cross(b, c) / 2
        sides = np.stack([b - c, a - c, a - b])
        measured = sides
        if self._tensors is not None:
            area_slope = area_slope * self._area_factor[corners, None]
            measured = np.einsum("nij,knj->kni", self._tensors[corners], sides)
        area = (area_slope * a).sum(axis=1)
        cotangents = self._cotangents[:, corners]
        dirichlet = (cotangents * (sides * measured).sum(axis=2)).sum(axis=0) / 2
        ratio = (self._areas[corners] / np.maximum(area, 1e-30)) ** 2
        energy = np.where(area > 0, dirichlet * (1 + ratio), np.inf)
        return _Terms(energy, dirichlet, ratio, area, area_slope, cotangents[1:], measured[1:])

    @no_type_check
    def _sum(self, terms: _Terms, group: Independent) -> Float[Array, " n"]:
        return np.add.reduceat(terms.energy**2 / (2 * self._areas[group.corners]), group.starts)

    def _slopes(self, terms: _Terms, group: Independent) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
        """The gradient of each vertex's sum, and about its largest second derivative."""
        slope = (terms.cotangents[:, :, None] * terms.sides).sum(axis=0) * (1 + terms.ratio)[:, None]
        slope -= (2 * terms.dirichlet * terms.ratio / terms.area)[:, None] * terms.area_slope
        curvature = np.abs(terms.cotangents.sum(axis=0)) * (1 + terms.ratio)
        if self._tensors is not None:
            curvature = curvature * self._trace[group.corners]
        curvature += 6 * terms.dirichlet * terms.ratio / terms.area**2 * (terms.area_slope**2).sum(axis=1)
        outer = terms.energy / self._areas[group.corners]
        curvature = outer * (curvature + (slope**2).sum(axis=1) / terms.energy)
        return np.add.reduceat(outer[:, None] * slope, group.starts), np.add.reduceat(curvature, group.starts)


def independent(corners: Int[Array, "c 3"], fixed: Bool[Array, " v"] | None) -> Iterator[Independent]:
    """All vertices that may move, by colour; `corners` are in groups by the first of each."""
    starts = np.flatnonzero(np.diff(corners[:, 0], prepend=-1))
    ends, vertices = np.append(starts[1:], len(corners)), corners[starts, 0]
    colors = dict[int, int]()
    neighbours = corners[:, 1].tolist()
    for vertex, start, end in zip(vertices.tolist(), starts.tolist(), ends.tolist(), strict=True):
        taken = {colors[other] for other in neighbours[start:end] if other in colors}
        colors[vertex] = next(color for color in range(len(taken) + 1) if color not in taken)
    color = np.array([colors[vertex] for vertex in vertices.tolist()])
    if fixed is not None:
        color[fixed[vertices]] = -1
    for wanted in range(color.max() + 1):
        chosen = np.flatnonzero(color == wanted)
        if not len(chosen):
            continue
        counts = ends[chosen] - starts[chosen]
        owner = np.repeat(np.arange(len(chosen)), counts)
        first = np.cumsum(counts) - counts
        rows = np.arange(counts.sum()) - first[owner] + starts[chosen][owner]
        yield Independent(vertices[chosen], rows, first, owner)


def sphere_sized(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "v 3"]:
    """The mesh, scaled to the area of the unit sphere."""
    return vertices * np.sqrt(2 * SPHERE / np.linalg.norm(face_normals(vertices, faces), axis=1).sum())


def edge_columns(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3 2"]:
    """The two sides of each triangle that start at its first corner, as columns."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.stack([b - a, c - a], axis=2)
