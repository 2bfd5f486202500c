"""A smooth closed surface through oriented points of unequal density: screened Poisson reconstruction on a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray as Array
from scipy import fft, ndimage, sparse

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Layer

_DENSITY_BLUR = 1.0
"""Standard deviation in cells that the density of the points is smoothed with."""
_THINNEST = 0.05
"""Points per unit of area, in cells, below which density no longer counts: a lone point is no sheet."""
_NEAR = 0.3
"""Nodes of at least this density share the screening, in the preconditioner."""
_WEAKEST, _STRONGEST = 0.02, 64.0
"""Bounds of the screening."""
_TOLERANCE = 2e-3
_STEPS = 60
"""Of conjugate gradients; some 10 reach the tolerance."""


def screened_poisson(grid: Grid, layer: Layer, blur: float, screening: float) -> Float[Array, "x y z"]:
    """Numbers that are positive inside, zero at the surface and change by a fraction of 1 from node to node there.

    They are chi - c, where chi on the nodes, 0 beyond them, minimises
    sum |grad chi - v|^2 + sum_i s_i a_i (chi(p_i) - c)^2. v are the points' inward normals, each standing for the
    area a_i that its neighbours leave it, and smoothed: chi is about 0 outside and larger inside. c is the mean of
    chi at the points without the second term, which holds the surface to them. Gaps are bridged.

    Lengths are in cells. The Laplacian is inverted by sine transforms, which also precondition the whole.

    Args:
        grid: where the numbers are wanted.
        layer: the points.
        blur: standard deviation in cells that the normals are smoothed with.
        screening: s_i where opaque centres are a cell apart; it falls with the square of how far apart they are.

    Reference: Kazhdan and Hoppe, Screened Poisson surface reconstruction, 2013.
    """
    at = _interpolation(grid, layer.points)
    back = sparse.csr_array(at.T)
    count = (back @ np.ones(len(layer.points))).reshape(grid.shape)
    density = ndimage.gaussian_filter(count, _DENSITY_BLUR) * (np.sqrt(2.0 * np.pi) * _DENSITY_BLUR)
    area = 1.0 / np.maximum(at @ density.ravel(), _THINNEST)
    mass = area * layer.weights
    detail = np.maximum(layer.detail / grid.step, 1e-3)
    holds = mass * np.clip(screening * detail**-2.0, _WEAKEST, _STRONGEST)
    vectors = -layer.normals * mass[:, None]
    source = _divergence(
        [
            ndimage.gaussian_filter((back @ vectors[:, axis]).reshape(grid.shape), blur, mode="constant")
            for axis in range(3)
        ]
    )
    spectrum = _spectrum(grid.shape)
    chi = _inverse(source, spectrum, 0.0)
    level = float(np.average(at @ chi.ravel(), weights=mass))

    def screened(values: Float[Array, "x y z"]) -> Float[Array, "x y z"]:
        return (back @ (holds * (at @ values.ravel()))).reshape(grid.shape)

    shift = 0.5 * float(holds.sum()) / max(1, int((density > _NEAR).sum()))
    wanted = source + screened(np.full(grid.shape, level))
    residual = wanted - _laplacian(chi) - screened(chi)
    goal = _TOLERANCE * float(np.linalg.norm(wanted))
    direction, before = np.zeros_like(chi), 1.0
    for _ in range(_STEPS):
        if float(np.linalg.norm(residual)) <= goal:
            break
        better = _inverse(residual, spectrum, shift)
        now = float((residual * better).sum())
        direction = better + (now / before) * direction
        image = _laplacian(direction) + screened(direction)
        step = now / float((direction * image).sum())
        chi = chi + step * direction
        residual = residual - step * image
        before = now
    return chi - level


def _divergence(vectors: Sequence[Float[Array, "x y z"]]) -> Float[Array, "x y z"]:
    """Of a vector field on the nodes, axis by axis; between two nodes their mean counts."""
    total = np.zeros_like(vectors[0])
    for axis, field in enumerate(vectors):
        along, target = np.moveaxis(field, axis, 0), np.moveaxis(total, axis, 0)
        edges = 0.5 * (along[1:] + along[:-1])
        target[1:] += edges
        target[:-1] -= edges
    return total


def _spectrum(shape: tuple[int, int, int]) -> Float32[Array, "x y z"]:
    """The Laplacian's factors of sine waves."""
    x, y, z = (2.0 - 2.0 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) for n in shape)
    return np.asarray(x[:, None, None] + y[None, :, None] + z[None, None, :], dtype=np.float32)


def _inverse(values: Float[Array, "x y z"], spectrum: Float32[Array, "x y z"], shift: float) -> Float[Array, "x y z"]:
    """Solution of (Laplacian + shift) x = values, in single precision."""
    waves = np.asarray(fft.dstn(values.astype(np.float32), type=1))
    return np.asarray(fft.idstn(waves / (spectrum + np.float32(shift)), type=1), dtype=np.float64)


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
