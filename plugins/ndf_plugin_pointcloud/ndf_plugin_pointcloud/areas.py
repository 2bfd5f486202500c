"""How much surface each point stands for."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
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
_BLOCK = 8192
_LARGEST = 25.0
"""Most area of a point, in medians: outliers stand for little."""


def point_areas(tree: KDTree, normals: Float[Array, "n 3"], threads: int = 1) -> Float[Array, " n"]:
    """Area of each point's Voronoi cell in its tangent plane.

    A cell is convex, so its area is the mean square of the distances to its rim, times pi. The rim is the nearest of
    the bisectors with the 20 nearest neighbours, laid into the plane at their true distances. Those that face away do
    not count: they are on the other side of a thin part.

    Cells are large beside gaps, where discs that hold 20 points each are not: there the winding number inside of a
    plate would fall below one half, and leave a hole in it.

    Args:
        tree: of distinct points.
        normals: unit.
        threads: for the search.

    Reference: Barill, Dickson, Schmidt, Levin and Jacobson, Fast winding numbers for soups and clouds, 2018, Sec. 4.
    """
    points = np.asarray(tree.data)
    count = min(NEIGHBOURS, len(points) - 1)
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    compass = np.stack([np.cos(angles), np.sin(angles)])
    area = np.empty(len(points))
    for start in range(0, len(points), _BLOCK):
        rows = slice(start, start + _BLOCK)
        distance, index = (np.asarray(x)[:, 1:] for x in tree.query(points[rows], k=count + 1, workers=threads))
        same = np.einsum("nkc,nc->nk", normals[index], normals[rows]) > _AWAY
        flat = (points[index] - points[rows, None]) @ axes_of(normals[rows])[:, :, 1:]
        flat /= np.maximum(np.linalg.norm(flat, axis=2, keepdims=True), 1e-300)
        # A bisector is half of a neighbour's distance away, over the cosine of its direction.
        nearness = np.where(same, 2 / distance, 0.0)[:, :, None] * (flat @ compass)
        disc = distance[:, -1] / np.sqrt(np.maximum(same.sum(axis=1), 1))
        # Past the border of a sheet, or of a hole, there are none: there the cell goes on as it is elsewhere.
        nearest = nearness.max(axis=1)
        bounded = nearest > 1 / (_RIM * disc[:, None])
        squares = np.where(bounded, nearest, np.inf) ** -2.0
        area[rows] = np.pi * np.where(
            bounded.any(axis=1), squares.sum(axis=1) / np.maximum(bounded.sum(axis=1), 1), disc**2
        )
    return np.minimum(area, _LARGEST * np.median(area))
