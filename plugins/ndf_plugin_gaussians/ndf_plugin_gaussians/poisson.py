"""A smooth closed surface through oriented points of unequal density: screened Poisson reconstruction on a grid."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy import fft, ndimage, sparse

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Layer

_DENSITY_BLUR = 1.0
"""The same for the density of the points."""
_THINNEST = 0.05
"""Points per unit of area, in cells, below which density no longer counts: a lone point is no sheet."""
_NEAR = 0.3
"""Nodes of at least this density share the screening, in the preconditioner."""
_WEAKEST, _STRONGEST = 0.02, 64.0
"""Bounds of the pieces' screening."""
_TOLERANCE = 2e-3
_STEPS = 60
"""Of conjugate gradients; some 20 to 40 reach the tolerance."""


class ScreenedPoisson:
    """Minimises sum |grad chi - v|^2 + sum_i s_i a_i (chi(p_i) - c)^2 + sum_k t_k (chi(z_k) - c)^2 over numbers chi
    on a grid, 0 beyond it.

    v are the points' inward normals, each standing for the area a_i that its neighbours leave it, and smoothed: chi
    is about 0 outside and larger inside. c is the mean of chi at the points without the other terms. Those hold the
    surface to the points, loosely, and to the opaque centres z_k, strongly. A layer with n centres per cell follows
    their waves longer than about 2 pi / (n t) cells: where centres are far apart their positions say little, and
    where they are close together much. Gaps are bridged.

    Lengths are in cells. The Laplacian is inverted by sine transforms, which also precondition the whole.

    Reference: Kazhdan and Hoppe, Screened Poisson surface reconstruction, 2013.
    """

    def __init__(self, grid: Grid, layer: Layer, blur: float, loose: float) -> None:
        """Solve without the second and third term.

        Args:
            grid: where chi is wanted.
            layer: points and centres.
            blur: standard deviation in cells that the normals are smoothed with.
            loose: s_i where opaque centres are a cell apart; it falls with the square of how far apart they are.
        """
        self._shape = grid.shape
        self._at = _interpolation(grid, layer.points)
        count = (self._at.T @ np.ones(len(layer.points))).reshape(grid.shape)
        density = ndimage.gaussian_filter(count, _DENSITY_BLUR) * (np.sqrt(2.0 * np.pi) * _DENSITY_BLUR)
        area = 1.0 / np.maximum(self._at @ density.ravel(), _THINNEST)
        mass = area * layer.weights
        detail = np.maximum(layer.detail / grid.step, 1e-3)
        self._loose = mass * np.clip(loose * detail**-2.0, _WEAKEST, _STRONGEST)
        self._back = sparse.csr_array(self._at.T)
        self._at_centres = _interpolation(grid, layer.centres)
        self._back_centres = sparse.csr_array(self._at_centres.T)
        self._source = self._divergence(-layer.normals * mass[:, None], blur)
        waves = [2.0 - 2.0 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) for n in grid.shape]
        self._spectrum = np.asarray(
            waves[0][:, None, None] + waves[1][None, :, None] + waves[2][None, None, :], dtype=np.float32
        )
        self._chi = self._inverse(self._source, 0.0)
        self._level = float(np.average(self._at @ self._chi.ravel(), weights=mass))
        self._near = max(1, int((density > _NEAR).sum()))

    def solve(self, holds: Float[Array, " k"]) -> Float[Array, "x y z"]:
        """chi - c: positive inside, zero at the surface. Starts from the answer before.

        Args:
            holds: t_k, of each of the layer's centres.
        """

        def screening(chi: Float[Array, "x y z"]) -> Float[Array, "x y z"]:
            flat = chi.ravel()
            loose = self._back @ (self._loose * (self._at @ flat))
            return (loose + self._back_centres @ (holds * (self._at_centres @ flat))).reshape(self._shape)

        shift = 0.5 * float(self._loose.sum() + holds.sum()) / self._near
        wanted = self._source + screening(np.full(self._shape, self._level))
        chi = self._chi
        residual = wanted - _laplacian(chi) - screening(chi)
        goal = _TOLERANCE * float(np.linalg.norm(wanted))
        direction, before = np.zeros_like(chi), 1.0
        for _ in range(_STEPS):
            if float(np.linalg.norm(residual)) <= goal:
                break
            better = self._inverse(residual, shift)
            now = float((residual * better).sum())
            direction = better + (now / before) * direction
            image = _laplacian(direction) + screening(direction)
            step = now / float((direction * image).sum())
            chi = chi + step * direction
            residual = residual - step * image
            before = now
        self._chi = chi
        return chi - self._level

    def _divergence(self, vectors: Float[Array, "n 3"], blur: float) -> Float[Array, "x y z"]:
        """Of the vectors at the points, shared out to nodes and smoothed; between two nodes their mean counts."""
        total = np.zeros(self._shape)
        for axis in range(3):
            field = ndimage.gaussian_filter(
                (self._at.T @ vectors[:, axis]).reshape(self._shape), blur, mode="constant"
            )
            along, target = np.moveaxis(field, axis, 0), np.moveaxis(total, axis, 0)
            edges = 0.5 * (along[1:] + along[:-1])
            target[1:] += edges
            target[:-1] -= edges
        return total

    def _inverse(self, values: Float[Array, "x y z"], shift: float) -> Float[Array, "x y z"]:
        """Solution of (Laplacian + shift) x = values, in single precision."""
        waves = np.asarray(fft.dstn(values.astype(np.float32), type=1))
        return np.asarray(fft.idstn(waves / (self._spectrum + np.float32(shift)), type=1), dtype=np.float64)


def _interpolation(grid: Grid, points: Float[Array, "n 3"]) -> sparse.csr_array:
    """Matrix of trilinear interpolation at the points."""
    place = (points - grid.low) / grid.step
    first = np.clip(np.floor(place), 0, np.array(grid.shape) - 2).astype(np.int64)
    share = np.clip(place - first, 0.0, 1.0)
    corners = list(np.ndindex(2, 2, 2))
    weights = np.stack([np.where(corner, share, 1.0 - share).prod(axis=1) for corner in corners], axis=1)
    index = np.stack([np.ravel_multi_index(tuple((first + corner).T), grid.shape) for corner in corners], axis=1)
    ends = np.arange(0, index.size + 1, len(corners))
    return sparse.csr_array((weights.ravel(), index.ravel(), ends), shape=(len(points), int(np.prod(grid.shape))))


def _laplacian(values: Float[Array, "x y z"]) -> Float[Array, "x y z"]:
    """Six times each value less its neighbours, which are 0 beyond the grid."""
    total = 6.0 * values
    for axis in range(3):
        along, target = np.moveaxis(values, axis, 0), np.moveaxis(total, axis, 0)
        target[1:] -= along[:-1]
        target[:-1] -= along[1:]
    return total
