"""The surface through the visible layer, as smooth as the centres' own scatter allows."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary, Layer
from ndf_plugin_gaussians.poisson import ScreenedPoisson
from ndf_plugin_gaussians.solid import Ground, meshed

_WEAKEST, _STRONGEST, _FACTOR = 4.0, 64.0, np.sqrt(2.0)
"""How strongly a centre holds the surface: the first of these whose surface is near enough to the centres."""
_ENOUGH = 1.0
"""Median distance of the centres from the surface, in those from the planes of their neighbours."""
_LEAST = 0.05
"""Cells below which the distance is no longer told from none."""
_SMOOTH, _SHEET = (1.2, 0.1), (0.7, 8.0)
"""Standard deviation in cells that normals are smoothed with, and how strongly pieces hold the surface. A wide one
gives a smoother surface between centres, but the sides of a sheet without thickness cancel, and it is gone; and its
centres hold neither side, as they lie between."""
_REACHED = 0.9
"""Share of the centres near the solid's boundary that the smooth surface must pass by, or there are sheets."""
_NEIGHBOURS = 25
_NEAR = 1.5
"""Centres this near to the surface, in cells, decide its level."""


def smooth_surface(
    grid: Grid, layer: Layer, opaque: Float[Array, "k 3"], ground: Ground | None
) -> Float[Array, "x y z"]:
    """Numbers that are positive inside and change by about 1 from node to node near the surface.

    Its hold on the centres grows until they are hardly farther from it than from the planes of their neighbours, in
    the median: what is nearer follows their scatter. A centre counts the less the more scatters it is away, since
    splats lie behind others. The level that halves the centres near the surface is the surface, as smoothing draws
    it inwards.

    Below the ground nothing is left.

    Args:
        grid: where the numbers are wanted.
        layer: the visible pieces.
        opaque: centres of opaque splats.
        ground: that the object stands on.

    Reference: Morozov's discrepancy principle, for the strength; Cauchy's weights, from the strength before.
    """
    poisson = _reconstruction(grid, layer)
    scatter = max(float(np.median(plane_distances(opaque))), _LEAST * grid.step)
    strength = _WEAKEST
    chi = poisson.solve(np.zeros(len(layer.centres)))
    while True:
        slope = float(np.median(grid.values(np.linalg.norm(np.gradient(chi), axis=0), opaque)))
        value = grid.values(chi, opaque)
        near = np.abs(value) <= _NEAR * slope
        level = float(np.median(value[near])) if near.any() else 0.0
        field = (chi - level) / slope
        if strength > _STRONGEST or _misfit(field, grid, opaque) <= _ENOUGH * scatter:
            break
        away = grid.values(chi, layer.centres) / slope
        chi = poisson.solve(strength / (1.0 + (away * grid.step / scatter) ** 2))
        strength *= _FACTOR
    if ground is not None:
        index = np.indices(grid.shape).reshape(3, -1).T
        field = np.minimum(field, ground.height(grid.nodes(index)).reshape(grid.shape) / grid.step)
    return field


def _reconstruction(grid: Grid, layer: Layer) -> ScreenedPoisson:
    """The smooth one, if it passes by the layer's centres though nothing holds it to them."""
    poisson = ScreenedPoisson(grid, layer, *_SMOOTH)
    chi = poisson.solve(np.zeros(len(layer.centres)))
    slopes = grid.values(np.linalg.norm(np.gradient(chi), axis=0), layer.points)
    away = np.abs(grid.values(chi, layer.centres))
    reached = (away <= _NEAR * np.median(slopes)).sum() >= _REACHED * len(away)
    return poisson if reached else ScreenedPoisson(grid, layer, *_SHEET)


def _misfit(field: Float[Array, "x y z"], grid: Grid, opaque: Float[Array, "k 3"]) -> float:
    """Median distance of the centres from the surface, in input units; infinite where there is none."""
    if not (field > 0).any():
        return np.inf
    return float(np.median(Boundary(meshed(field, grid)).closest(opaque)[0]))


def plane_distances(points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance of each point from the least-squares plane of its nearest neighbours, itself not among them."""
    count = min(_NEIGHBOURS, len(points) - 1)
    index = np.asarray(KDTree(points).query(points, k=count + 1)[1])[:, 1:]
    offset = points[index] - points[index].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nkx,nky->nxy", offset, offset))[1][:, :, 0]
    return np.abs(((points - points[index].mean(axis=1)) * normals).sum(axis=1))
