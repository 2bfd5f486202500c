"""The surface of splats as numbers on a grid: heights above the mean planes of those that are seen."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy import ndimage

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary
from ndf_plugin_gaussians.moving_planes import MovingPlanes

_REACH = 4.5
"""Nodes deeper below the solid's boundary, in cells, are inside for certain."""
_SLACK = 1.5
"""Cells that heights may differ from the depth below the solid's boundary: a plane goes on beyond an edge, and the
boundary does not."""
_FAIRING = 0.4
"""Standard deviation in cells that the heights are smoothed with."""
_NEAR = 1.5
"""Centres this near to the surface, in cells, decide its level."""


def heights(
    solid: Float[Array, "x y z"], grid: Grid, boundary: Boundary, planes: MovingPlanes, depth: float
) -> Float[Array, "x y z"]:
    """Height of every node above the surface in input units, negative inside.

    Just below the boundary of the solid that is the height above the planes of the splats there, elsewhere that above
    the boundary itself, lowered by `depth`.

    Args:
        solid: positive inside, zero at the boundary; a cell of `grid` is much less than the solid.
        grid: of all arrays.
        boundary: of the solid.
        planes: of the visible splats.
        depth: how far below the boundary these lie, about; input units.
    """
    inside = solid > 0
    below = np.asarray(ndimage.distance_transform_edt(inside))
    above = np.asarray(ndimage.distance_transform_edt(~inside))
    field = (above - below) * grid.step + depth
    nodes = np.argwhere(inside & (below <= _REACH))
    points = grid.nodes(nodes)
    distance, guide = boundary.closest(points)
    height, _, known = planes.at(points, guide)
    # How deep they really lie: the border of a thick or faint skin is elsewhere.
    shell = float(np.median(boundary.closest(planes.layer.points)[0])) - distance
    slack = _SLACK * grid.step
    field[tuple(nodes.T)] = np.where(known, np.clip(height, shell - slack, shell + slack), shell)
    return ndimage.gaussian_filter(field, _FAIRING, mode="nearest")


def middle_level(field: Float[Array, "x y z"], grid: Grid, centres: Float[Array, "n 3"]) -> float:
    """The height that half of the centres near the surface lie above: smoothing draws it inwards where it is convex,
    and splats behind others draw it inwards everywhere."""
    level = grid.values(field, centres)
    near = np.abs(level) <= _NEAR * grid.step
    return float(np.median(level[near])) if near.any() else 0.0
