"""How much surface each point stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_pointcloud.frames import axes_of

NEIGHBOURS = 20
_DIRECTIONS = 24
"""That a cell's rim is looked for in."""
_RIM = 2.5
"""Farthest rim of a cell, in radii of the disc that is as dense as its neighbourhood. Of random points 1.4% of the
corners of cells are farther."""
_AWAY = -0.5
"""Cosine between normals; across the edge of a cube it is 0, and there both faces share one cell."""
THINNEST = 0.3
"""Points whose smaller spread is less than this share of the larger one lie along a curve, as on scan lines."""
_BLOCK = 8192
_LARGEST = 25.0
"""Most area of a point, in medians: outliers stand for little."""


PointAreas = Callable[[KDTree, Float[Array, "n 3"], int], Float[Array, " n"]]
"""``areas(tree, normals, threads)``: of each point of a tree of distinct points with unit normals. Neighbours that
face away do not count: they are on the other side of a thin part, and with them both sides would be half as large."""


def disc_areas(tree: KDTree, normals: Float[Array, "n 3"], threads: int = 1) -> Float[Array, " n"]:
    """From the disc that holds the 20 nearest neighbours: pi r^2 / 20.

    The point itself is in the disc too, so of 21 points with one on the rim 20 count.
    """
    area = np.empty(len(tree.data))
    for rows, distance, _, same in _neighbours(tree, normals, threads):
        area[rows] = _disc(distance, same)
    return np.minimum(area, _LARGEST * np.median(area))


def cell_areas(tree: KDTree, normals: Float[Array, "n 3"], threads: int = 1) -> Float[Array, " n"]:
    """Of Voronoi cells in tangent planes.

    A cell is convex, so its area is the mean square of the distances to its rim, times pi. The rim is the nearest of
    the bisectors with the 20 nearest neighbours, laid into the plane at their true distances. Points along a curve
    have the areas of discs.

    Cells are large beside gaps, where discs are not: there the winding number inside of a plate would fall below one
    half, and leave a hole in it. At the border of a hole they are half as large as discs.

    Reference: Barill, Dickson, Schmidt, Levin and Jacobson, Fast winding numbers for soups and clouds, 2018, Sec. 4.
    """
    points = np.asarray(tree.data)
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    compass = np.stack([np.cos(angles), np.sin(angles)])
    area = np.empty(len(points))
    for rows, distance, index, same in _neighbours(tree, normals, threads):
        ways = (points[index] - points[rows, None]) @ axes_of(normals[rows])[:, :, 1:]
        ways /= np.maximum(np.linalg.norm(ways, axis=2, keepdims=True), 1e-300)
        # Directions are counted from the nearest neighbour's, so that they turn with the points.
        first = ways[:, 0]
        ways = np.stack(
            [np.einsum("nkc,nc->nk", ways, first), np.einsum("nkc,nc->nk", ways, first[:, ::-1] * [-1, 1])], axis=2
        )
        # A bisector is half of a neighbour's distance away, over the cosine of its direction.
        nearest = (np.where(same, 2 / distance, 0.0)[:, :, None] * (ways @ compass)).max(axis=1)
        # Past the border of a sheet, or of a hole, there are none: there the cell goes on as it is elsewhere.
        disc = _disc(distance, same)
        bounded = nearest > 1 / (_RIM * np.sqrt(disc[:, None] / np.pi))
        known = bounded.any(axis=1) & ~_along_a_curve((same * distance)[:, :, None] * ways)
        squares = np.where(bounded, nearest, np.inf) ** -2.0
        cell = np.pi * squares.sum(axis=1) / np.maximum(bounded.sum(axis=1), 1)
        area[rows] = np.where(known, cell, disc)
    return np.minimum(area, _LARGEST * np.median(area))


def _neighbours(
    tree: KDTree, normals: Float[Array, "n 3"], threads: int
) -> Iterator[tuple[slice, Float[Array, "m k"], Int[Array, "m k"], Bool[Array, "m k"]]]:
    """Blocks of points: distances and indices of their neighbours, and whether these face the same way."""
    points = np.asarray(tree.data)
    count = min(NEIGHBOURS, len(points) - 1)
    for start in range(0, len(points), _BLOCK):
        rows = slice(start, start + _BLOCK)
        distance, index = (np.asarray(x)[:, 1:] for x in tree.query(points[rows], k=count + 1, workers=threads))
        yield rows, distance, index, np.einsum("nkc,nc->nk", normals[index], normals[rows]) > _AWAY


def _disc(distance: Float[Array, "m k"], same: Bool[Array, "m k"]) -> Float[Array, " m"]:
    return np.pi * distance[:, -1] ** 2 / (1 + same[:, :-1].sum(axis=1))


def _along_a_curve(offsets: Float[Array, "n k 2"]) -> Bool[Array, " n"]:
    """Whether neighbours spread in one direction only: how wide the strip beside a curve is they do not say."""
    x, y = offsets[:, :, 0], offsets[:, :, 1]
    xx, yy, xy = (x * x).sum(axis=1), (y * y).sum(axis=1), (x * y).sum(axis=1)
    between = np.hypot(xx - yy, 2 * xy)
    return xx + yy - between < THINNEST**2 * (xx + yy + between)
