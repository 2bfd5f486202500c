"""A drawn base mesh settles, so that the flat triangles between its vertices on the surface fold as little as can be.

A triangle across a limb or a crease may face against the surface although its drawing is not turned over. So each
vertex moves over the drawing to where its flat triangles are less distorted. One that faces against the surface has a
finite distortion, which grows as the others improve.

Reference: the regularised energy of Garanzha, Kaporin, Kudryavtseva, Protais, Ray and Sokolov 2021.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.fitting.sphere_distortion import Independent, independent
from ndf_core.fitting.sphere_surface import DrawnSurface
from ndf_core.mesh import face_normals, unit

_SWEEPS = 60
_SOFTNESS = (0.02, 0.2)
"""At least, and as a share of the area ratio of the worst triangle that faces against the surface."""
_FIRST = 2.0
"""Steps are tried from this multiple of about Newton's down, each half of the one before ..."""
_TRIES = 10
"""... this many at most."""


@dataclass
class _Vertices:
    """Of the base mesh, drawn and landed."""

    drawn: Float[Array, "v 3"]
    points: Float[Array, "v 3"]
    normals: Float[Array, "v 3"]
    back: Float[Array, "v 3 3"]


class _Triangles(NamedTuple):
    """With a vertex `a` that moves, and what stays: b, c, the sum of their normals, and the triangle before.

    Its Jacobian is the sum over a, b, c of their points times their gradients.
    """

    b: Float[Array, "n 3"]
    c: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    gradients: Float[Array, "n 3 2"]
    shares: Float[Array, " n"]


def settled(
    drawn: Float[Array, "v 3"],
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    fixed: Bool[Array, " v"],
    surface: DrawnSurface,
) -> Float[Array, "v 3"]:
    """Where the vertices are drawn afterwards; no triangle of the drawing is turned over.

    Args:
        drawn: where they are drawn, unit vectors; no triangle turned over.
        vertices, faces: the base mesh, with as much area as the surface.
        fixed: vertices that stay.
        surface: that is covered.
    """
    return _Settling(drawn, vertices, faces, fixed, surface).run()


class _Settling:
    def __init__(
        self,
        drawn: Float[Array, "v 3"],
        vertices: Float[Array, "v 3"],
        faces: Int[Array, "f 3"],
        fixed: Bool[Array, " v"],
        surface: DrawnSurface,
    ) -> None:
        self._surface = surface
        self._now = _Vertices(drawn.copy(), *surface.landed(drawn))
        turns = ([0, 1, 2], [1, 2, 0], [2, 0, 1])
        corners = np.concatenate([faces[:, turn] for turn in turns])
        order = np.argsort(corners[:, 0], kind="stable")
        self._corners, gradients = corners[order], _gradients(vertices, faces)
        self._gradients = np.concatenate([gradients[:, turn] for turn in turns])[order]
        areas = np.linalg.norm(face_normals(vertices, faces), axis=1)
        self._shares = np.tile(areas / areas.sum(), 3)[order]
        self._groups = list(independent(self._corners, fixed))

    def run(self) -> Float[Array, "v 3"]:
        for _ in range(_SWEEPS):
            softness = self._softness()
            for group in self._groups:
                self._move(group, softness)
        return self._now.drawn

    def _softness(self) -> float:
        everything = np.arange(len(self._corners))
        a = self._corners[:, 0]
        ratios = _area_ratios(self._triangles(everything), self._now.points[a], self._now.normals[a])[2]
        return float(np.hypot(_SOFTNESS[0], _SOFTNESS[1] * min(ratios.min(), 0.0)))

    def _triangles(self, rows: Int[Array, " n"]) -> _Triangles:
        now, (_, b, c) = self._now, self._corners[rows].T
        return _Triangles(
            now.points[b], now.points[c], now.normals[b] + now.normals[c], self._gradients[rows], self._shares[rows]
        )

    def _move(self, group: Independent, softness: float) -> None:
        """Each vertex by its own step, if it lowers the sum and turns nothing over."""
        now, own, owner, starts = self._now, group.vertices, group.owner, group.starts
        triangles = self._triangles(group.corners)
        walls = np.cross(*now.drawn[self._corners[group.corners, 1:]].transpose(1, 0, 2))
        energy, slope, curvature = _slopes(triangles, now.points[own][owner], now.normals[own][owner], softness)
        best = np.add.reduceat(energy, starts)
        before = best.copy()
        step = -_FIRST * np.add.reduceat(slope, starts) / np.add.reduceat(curvature, starts)[:, None]
        step -= (step * now.normals[own]).sum(axis=1, keepdims=True) * now.normals[own]
        here = now.drawn[own]
        step = np.einsum("nij,nj->ni", now.back[own], step)
        for count in range(_TRIES):
            tried = unit(here + step)
            points, normals, back = self._surface.landed(tried)
            found = np.add.reduceat(_energy(triangles, points[owner], normals[owner], softness), starts)
            better = (found < best) & (np.minimum.reduceat((walls * tried[owner]).sum(axis=1), starts) > 0)
            best[better], chosen = found[better], own[better]
            now.drawn[chosen], now.points[chosen] = tried[better], points[better]
            now.normals[chosen], now.back[chosen] = normals[better], back[better]
            if count > 1 and (best < before).all():
                break
            step *= 0.5


def _gradients(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3 2"]:
    """Of the barycentric weights, in two directions along each triangle."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    along = unit(b - a)
    across = unit(np.cross(np.cross(b - a, c - a), along))
    sides = np.stack([b - a, c - a], axis=1) @ np.stack([along, across], axis=2)
    two = np.linalg.inv(sides).transpose(0, 2, 1)
    return np.concatenate([-two.sum(axis=1, keepdims=True), two], axis=1)


def _area_ratios(
    triangles: _Triangles, a: Float[Array, "n 3"], normals: Float[Array, "n 3"]
) -> tuple[Float[Array, "n 3 2"], Float[Array, "n 3"], Float[Array, " n"]]:
    """Jacobians, normals of the surface, and areas by those before; negative where it faces against the surface."""
    gradients = triangles.gradients
    corners = np.stack([a, triangles.b, triangles.c], axis=2)
    jacobian, facing = corners @ gradients, unit(triangles.normals + normals)
    return jacobian, facing, (np.cross(jacobian[:, :, 0], jacobian[:, :, 1]) * facing).sum(axis=1)


def _energy(
    triangles: _Triangles, a: Float[Array, "n 3"], normals: Float[Array, "n 3"], softness: float
) -> Float[Array, " n"]:
    """Shares of the sum of all triangles' squares."""
    jacobian, _, ratio = _area_ratios(triangles, a, normals)
    return triangles.shares * _distortion(jacobian, ratio, _positive(ratio, softness)) ** 2


def _distortion(
    jacobian: Float[Array, "n 3 2"], ratio: Float[Array, " n"], positive: Float[Array, " n"]
) -> Float[Array, " n"]:
    return ((jacobian**2).sum(axis=(1, 2)) + 1 + ratio**2) / positive


def _positive(ratio: Float[Array, " n"], softness: float) -> Float[Array, " n"]:
    """About twice the ratio where it is positive, nearly zero where it is negative: r + sqrt(r^2 + softness^2)."""
    root = np.hypot(ratio, softness)
    return np.where(ratio > 0, ratio + root, softness**2 / (root - np.minimum(ratio, 0.0)))


def _slopes(
    triangles: _Triangles, a: Float[Array, "n 3"], normals: Float[Array, "n 3"], softness: float
) -> tuple[Float[Array, " n"], Float[Array, "n 3"], Float[Array, " n"]]:
    """The energy, its gradient by a, and about the largest second derivative."""
    jacobian, facing, ratio = _area_ratios(triangles, a, normals)
    positive, root = _positive(ratio, softness), np.hypot(ratio, softness)
    distortion = _distortion(jacobian, ratio, positive)
    own = triangles.gradients[:, 0]
    one, two = jacobian[:, :, 0], jacobian[:, :, 1]
    ratio_slope = np.cross(two, facing) * own[:, :1] + np.cross(facing, one) * own[:, 1:]
    by_ratio = 2 * ratio / positive - distortion / root
    slope = 2 * (jacobian @ own[:, :, None])[:, :, 0] / positive[:, None] + by_ratio[:, None] * ratio_slope
    curvature = 2 * (own**2).sum(axis=1) / positive
    curvature += (2 / positive + 2 * distortion / root**2) * (ratio_slope**2).sum(axis=1)
    outer = 2 * triangles.shares * distortion
    curvature = outer * (curvature + (slope**2).sum(axis=1) / distortion)
    return triangles.shares * distortion**2, outer[:, None] * slope, curvature
