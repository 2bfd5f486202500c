"""The surface between points without normals that bound a solid: quadrics through the points around each, blended."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_pointcloud.areas import THINNEST
from ndf_plugin_pointcloud.local_planes import AWAY, Discs
from ndf_plugin_pointcloud.shell import Closest

_BLENDED = 9
"""Quadrics that make the answer, those of the points nearest to it."""
_REACH = 2.0
"""A quadric curves within so many root mean square distances of its points from its middle; it is straight beyond."""
_STIFFNESS = 1e-3
"""Keeps slopes and curvatures at zero where the points do not say them: along a curve, across a sharp gap."""
_DOUBLED = 3
"""Points along a curve say nothing of the surface beside it: the neighbourhood is doubled, so many times at most."""
_NEWTON = 2
"""Steps to the closest point of a quadric."""
_BLOCK = 8192


class LocalQuadrics:
    """Closest points on quadrics, each fitted to the points around one of them, blended where they overlap.

    Planes flatten what is curved, by half of the error that is left between points; and a surface that takes its
    points from one nearest neighbourhood jumps where that changes. All weights here end at zero.

    Reference: Ohtake, Belyaev, Alexa, Turk and Seidel, Multi-level partition of unity implicits, 2003.
    """

    def __init__(
        self, points: Float[Array, "n 3"], neighbours: int, outwards: Float[Array, "n 3"], threads: int = 1
    ) -> None:
        """Fit one quadric at each point.

        Args:
            points: distinct.
            neighbours: points that a quadric is fitted to.
            outwards: a vector at each point that is on the outer side. Points that face away, beyond a thin part,
                count for nothing.
            threads: for the search.
        """
        self._tree, self._points = KDTree(points), points
        self._outwards = outwards / np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-300)
        self._count, self._blended = min(neighbours, len(points) - 1), min(_BLENDED, len(points) - 1)
        blocks = [
            self._fit_wide(np.arange(i, min(i + _BLOCK, len(points))), threads) for i in range(0, len(points), _BLOCK)
        ]
        frames = [np.concatenate(parts) for parts in zip(*blocks, strict=True)]
        self._middles, self._axes, self._scales, self._coefficients = frames

    def __call__(self, queries: Float[Array, "n 3"], threads: int) -> Closest:
        blocks = [self._block(queries[i : i + _BLOCK], threads) for i in range(0, max(len(queries), 1), _BLOCK)]
        return Closest(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))

    def _fit_wide(self, rows: Int[Array, " n"], threads: int) -> list[Float[Array, "n ..."]]:
        """Fit to neighbourhoods that are no curves, where there are such."""
        along, *fits = self._fit(rows, self._count, threads)
        for doubled in range(_DOUBLED):
            count = self._count * 2 ** (doubled + 1)
            if count >= len(self._points) or not along.any():
                break
            again = np.flatnonzero(along)
            still, *wider = self._fit(rows[again], count, threads)
            for old, new in zip(fits, wider, strict=True):
                old[again] = new
            along[again] = still
        return fits

    def _fit(
        self, rows: Int[Array, " n"], count: int, threads: int
    ) -> tuple[Bool[Array, " n"], *tuple[Float[Array, "n ..."], ...]]:
        """Whether the points lie along a curve; middles, axes (unit columns, the first outwards), scales, and six
        coefficients of the height over the plane of the other two axes, in scales."""
        index, weights = self._around(self._points[rows], count, threads)
        weights *= self._agreement(index, rows)
        nearby = self._points[index]
        discs = Discs.through(nearby, weights)
        side = np.einsum("nc,nc->n", discs.axes[:, :, 0], self._outwards[rows])
        axes = np.where(side < 0, -1.0, 1.0)[:, None, None] * discs.axes
        local = (nearby - discs.middles[:, None]) @ axes
        scales = np.maximum(np.sqrt((local[:, :, 1:] ** 2).sum(axis=2).mean(axis=1)), 1e-300)
        local /= scales[:, None, None]
        terms = _terms(local[:, :, 1], local[:, :, 2])
        weighted = (terms * (weights / weights.sum(axis=1, keepdims=True))[:, :, None]).transpose(0, 2, 1)
        normal = weighted @ terms + _STIFFNESS * np.diag([0.0, 1, 1, 1, 1, 1])
        along = discs.spreads[:, 0] < THINNEST * discs.spreads[:, 1]
        return along, discs.middles, axes, scales, np.linalg.solve(normal, weighted @ local[:, :, :1])[:, :, 0]

    def _block(self, queries: Float[Array, "n 3"], threads: int) -> Closest:
        distance, nearest = (np.asarray(rows) for rows in self._tree.query(queries, workers=threads))
        near = self._feet(queries, nearest[:, None])[0][:, 0]
        index, weights = self._around(near, self._blended, threads)
        weights = np.maximum(weights, AWAY) * self._agreement(index, index[:, 0])
        weights /= weights.sum(axis=1, keepdims=True)
        feet, normals = (np.einsum("nk,nkc->nc", weights, rows) for rows in self._feet(queries, index))
        return Closest(feet, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300), distance)

    def _around(
        self, places: Float[Array, "n 3"], count: int, threads: int
    ) -> tuple[Int[Array, "n k"], Float[Array, "n k"]]:
        """Points nearest to places, nearest first, with weights that fall to zero at the one after them."""
        distance, index = self._tree.query(places, k=count + 1, workers=threads)
        squared = np.asarray(distance).reshape(len(places), count + 1) ** 2
        weights = (1 - squared[:, :-1] / np.maximum(squared[:, -1:], 1e-300)) ** 2
        return np.asarray(index).reshape(len(places), count + 1)[:, :-1], weights

    def _agreement(self, index: Int[Array, "n k"], of: Int[Array, " n"]) -> Float[Array, "n k"]:
        return np.maximum(np.einsum("nkc,nc->nk", self._outwards[index], self._outwards[of]), AWAY)

    def _feet(
        self, queries: Float[Array, "n 3"], index: Int[Array, "n k"]
    ) -> tuple[Float[Array, "n k 3"], Float[Array, "n k 3"]]:
        """Closest points of some quadrics to each query, and unit normals there."""
        rows = index.ravel()
        axes, scales = self._axes[rows], self._scales[rows][:, None]
        offsets = (np.repeat(queries, index.shape[1], axis=0) - self._middles[rows]) / scales
        place = np.einsum("nc,nca->na", offsets, axes)
        foot, normal = place.copy(), place
        for _ in range(_NEWTON):
            height, slope = _height(self._coefficients[rows], foot[:, 1:])
            normal = np.column_stack([np.ones(len(rows)), -slope])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            beyond = np.einsum("na,na->n", place - np.column_stack([height, foot[:, 1:]]), normal)
            foot = place - beyond[:, None] * normal
        foot[:, 0] = _height(self._coefficients[rows], foot[:, 1:])[0]
        feet = self._middles[rows] + scales * np.einsum("na,nca->nc", foot, axes)
        return feet.reshape(*index.shape, 3), np.einsum("na,nca->nc", normal, axes).reshape(*index.shape, 3)


def _terms(u: Float[Array, "*n"], v: Float[Array, "*n"]) -> Float[Array, "*n 6"]:
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)


def _height(
    coefficients: Float[Array, "n 6"], places: Float[Array, "n 2"]
) -> tuple[Float[Array, " n"], Float[Array, "n 2"]]:
    """Height and slope of each quadric over a place; beyond its reach those of its tangent plane at the rim."""
    far = np.maximum(np.linalg.norm(places, axis=1, keepdims=True) / _REACH, 1)
    u, v = (places / far).T
    _, b, c, d, e, f = coefficients.T
    slope = np.column_stack([b + 2 * d * u + e * v, c + e * u + 2 * f * v])
    height = np.einsum("na,na->n", coefficients, _terms(u, v))
    return height + ((1 - 1 / far) * places * slope).sum(axis=1), slope
