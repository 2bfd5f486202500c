"""The surface through the visible layer: smooth, and near to the opaque centres where these are many."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy import ndimage
from scipy.spatial import KDTree

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary, Layer, spacing_at
from ndf_plugin_gaussians.poisson import screened_poisson
from ndf_plugin_gaussians.solid import Ground, meshed

_BLUR, _WIDEST = 10.0, 3.0
"""Standard deviation that normals are smoothed with, in scatters of the centres, and at most so many cells ..."""
_SIDES = 2.5
"""... and so many of them fit into a slab, whose sides would cancel otherwise."""
_SCREENING = 0.1
"""How strongly pieces hold the surface: little, so that between centres it is even."""
_SHEET = (0.7, 8.0)
"""The same, in cells, where there are sheets without thickness: their sides would cancel."""
_REACHED = 0.9
"""Share of the centres near the solid's boundary that the smooth surface must pass by, or there are sheets."""
_NEAR = 3.0
"""What is as near to the surface, in cells, it passes by; those centres decide its level."""
_REACH = 2.0
"""Centres farther away, in cells, do not draw it."""
_NARROWEST, _WIDTH = 0.6, 0.6
"""Standard deviation of a centre's pull, in cells, and in distances of a centre from its fifth neighbour."""
_LEVELS = ((4.0, 0.1), (1.0, 0.6))
"""Widths, in that one, and shares of the usual density of centres. Where there is so little, half of what they ask
for is done, and half of what those of the width before do: edges with few centres are drawn as lines, not beads."""
_GOAL = 1.21
"""Median distance of the centres from the surface that is near enough, in scatters: their median distance from the
planes of their neighbours."""
_MOST = 60
"""Pulls."""
_LEAST = 0.05
"""Cells below which a distance is no longer told from none."""
_NEIGHBOURS = 25


def smooth_surface(
    grid: Grid, layer: Layer, opaque: Float[Array, "k 3"], ground: Ground | None
) -> Float[Array, "x y z"]:
    """Numbers that are positive inside and change by about 1 from node to node near the surface.

    A reconstruction from widely smoothed normals is smooth, but rounds off details. It is drawn to the centres, all
    of them together: what it misses them by, averaged over about their spacing, is taken from its numbers, again and
    again, until it is hardly farther from them than they are from the planes of their neighbours, in the median: what
    is nearer follows their scatter. A centre counts the less the more scatters it is away, since splats lie behind
    others; and the level is the one that is nearest to them. Below the ground nothing is left.

    Args:
        grid: where the numbers are wanted.
        layer: the visible pieces.
        opaque: centres of opaque splats.
        ground: that the object stands on.

    Reference: Lee, Wolberg and Shin, Scattered data interpolation with multilevel B-splines, 1997 (corrections from
    wide to narrow); Morozov's discrepancy principle, for when to stop.
    """
    scatter = max(float(np.median(plane_distances(opaque))) / grid.step, _LEAST)
    spacing = max(float(np.median(spacing_at(opaque, opaque))) / grid.step, _LEAST)
    # Numbers at the centres are less than distances, about in proportion, and much cheaper: those tell when to look.
    goal = wanted = _GOAL * scatter
    before = after = _reconstruction(grid, layer, opaque, scatter)
    for _ in range(_MOST):
        before, after = after, _drawn(after, grid, layer.centres, scatter, spacing)
        value = grid.values(after, opaque)
        level = _densest_half(value)
        after -= level
        rough = float(np.median(np.abs(value - level)))
        if rough > wanted:
            continue
        near = _misfit(_above(ground, after, grid), grid, opaque)
        if near <= goal:
            far = _misfit(_above(ground, before, grid), grid, opaque)
            share = (far - goal) / (far - near) if far > goal else 0.0
            after = after if np.isinf(far) else before + share * (after - before)
            break
        if np.isfinite(near):
            wanted = rough * goal / near
    return _above(ground, after, grid)


def _reconstruction(grid: Grid, layer: Layer, opaque: Float[Array, "k 3"], scatter: float) -> Float[Array, "x y z"]:
    """From smooth normals, if it passes by the layer's centres; in cells, and such that it halves the opaque ones."""
    blur = min(_BLUR * scatter, _WIDEST, layer.thinnest / grid.step / _SIDES)
    chi = screened_poisson(grid, layer, blur, _SCREENING)
    slopes = grid.values(np.linalg.norm(np.gradient(chi), axis=0), layer.points)
    away = np.abs(grid.values(chi, layer.centres))
    if (away <= _NEAR * np.median(slopes)).sum() < _REACHED * len(away):
        chi = screened_poisson(grid, layer, *_SHEET)
    slope = float(np.median(grid.values(np.linalg.norm(np.gradient(chi), axis=0), opaque)))
    value = grid.values(chi, opaque)
    near = np.abs(value) <= _NEAR * slope
    return (chi - (float(np.median(value[near])) if near.any() else 0.0)) / slope


def _densest_half(values: Float[Array, " n"]) -> float:
    """Middle of the shortest interval that holds half of the values: the one with the least median distance."""
    ordered = np.sort(values)
    half = len(ordered) // 2
    first = int(np.argmin(ordered[half:] - ordered[: len(ordered) - half]))
    return float(ordered[first] + ordered[first + half]) / 2.0


def _drawn(
    field: Float[Array, "x y z"], grid: Grid, centres: Float[Array, "k 3"], scatter: float, spacing: float
) -> Float[Array, "x y z"]:
    """The field less what it is at the centres, averaged; all in cells."""
    value = grid.values(field, centres)
    weight = (np.abs(value) <= _REACH) / (1.0 + (value / scatter) ** 2)
    asked, count = (grid.deposit(centres, amount).astype(np.float32) for amount in (weight * value, weight))
    usual = 5.0 / (np.pi * spacing**2)  # centres per area whose fifth neighbour is so far away
    taken: Float[Array, "x y z"] | float = 0.0
    for factor, share in _LEVELS:
        width = factor * max(_NARROWEST, _WIDTH * spacing)
        near, many = (ndimage.gaussian_filter(each, width, mode="constant", truncate=3.0) for each in (asked, count))
        steady = share * usual / (np.sqrt(2.0 * np.pi) * width)  # in the middle of a layer of so many centres
        taken = (near + steady * taken) / (many + steady)
    return field - taken


def _above(ground: Ground | None, field: Float[Array, "x y z"], grid: Grid) -> Float[Array, "x y z"]:
    """The field, cut flat at the ground."""
    if ground is None:
        return field
    axis, sign = ground.side
    along = (ground.level - grid.low[axis]) / grid.step - np.arange(grid.shape[axis])
    shape = [1, 1, 1]
    shape[axis] = -1
    return np.minimum(field, (sign * along).reshape(shape))


def _misfit(field: Float[Array, "x y z"], grid: Grid, opaque: Float[Array, "k 3"]) -> float:
    """Median distance of the centres from the surface, in cells; infinite where there is none."""
    if not (field > 0).any():
        return np.inf
    return float(np.median(Boundary(meshed(field, grid)).closest(opaque)[0])) / grid.step


def plane_distances(points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance of each point from the least-squares plane of its nearest neighbours, itself not among them."""
    count = min(_NEIGHBOURS, len(points) - 1)
    index = np.asarray(KDTree(points).query(points, k=count + 1)[1])[:, 1:]
    offset = points[index] - points[index].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nkx,nky->nxy", offset, offset))[1][:, :, 0]
    return np.abs(((points - points[index].mean(axis=1)) * normals).sum(axis=1))
