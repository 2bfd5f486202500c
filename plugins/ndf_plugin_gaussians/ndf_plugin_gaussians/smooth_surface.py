"""The surface through the visible layer, as smooth as the centres' own scatter allows."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Layer
from ndf_plugin_gaussians.poisson import ScreenedPoisson
from ndf_plugin_gaussians.solid import Ground

_STRENGTHS = (2.0, 4.0, 8.0, 16.0)
"""Of the screening; the first whose surface is near enough to the centres is taken, or the last that was worth it."""
_ENOUGH = 1.2
"""Median distance of the centres from the surface, in those from the planes of their neighbours."""
_WORTH = 0.925
"""Twice the strength must bring the surface at least so much nearer, as a factor: nothing brings it to splats behind
others, and it gets rough on the way."""
_NEIGHBOURS = 25
_NEAR = 1.5
"""Centres this near to the surface, in cells, decide its level."""


def smooth_surface(
    grid: Grid, layer: Layer, opaque: Float[Array, "k 3"], ground: Ground | None
) -> Float[Array, "x y z"]:
    """Numbers that are positive inside and change by about 1 from node to node near the surface.

    The screening grows until the centres are hardly farther from the surface than from the planes of their
    neighbours, in the median: what is nearer follows their scatter. The level that halves the centres near the
    surface is the surface, since splats behind others, and smoothing, draw it inwards. Below the ground nothing is
    left.

    Args:
        grid: where the numbers are wanted.
        layer: the visible pieces.
        opaque: centres of opaque splats.
        ground: that the object stands on.

    Reference: Morozov's discrepancy principle, for the screening.
    """
    scatter = float(np.median(plane_distances(opaque)))
    poisson = ScreenedPoisson(grid, layer)
    field, misfit = np.zeros(grid.shape), np.inf
    for strength in _STRENGTHS:
        chi = poisson.solve(strength)
        slopes = grid.values(np.linalg.norm(np.gradient(chi), axis=0), opaque)
        value = grid.values(chi, opaque)
        slope = float(np.median(slopes))
        near = np.abs(value) <= _NEAR * slope
        level = float(np.median(value[near])) if near.any() else 0.0
        before = misfit
        misfit = float(np.median(np.abs(value - level) / np.maximum(slopes, 1e-300))) * grid.step
        if misfit > _WORTH * before:
            break
        field = (chi - level) / slope
        if misfit <= _ENOUGH * scatter:
            break
    if ground is not None:
        index = np.indices(grid.shape).reshape(3, -1).T
        field = np.minimum(field, ground.height(grid.nodes(index)).reshape(grid.shape) / grid.step)
    return field


def plane_distances(points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance of each point from the least-squares plane of its nearest neighbours, itself not among them."""
    count = min(_NEIGHBOURS, len(points) - 1)
    index = np.asarray(KDTree(points).query(points, k=count + 1)[1])[:, 1:]
    offset = points[index] - points[index].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nkx,nky->nxy", offset, offset))[1][:, :, 0]
    return np.abs(((points - points[index].mean(axis=1)) * normals).sum(axis=1))
