"""The solid drawn in to the splats: its boundary moved from the outside of their skin to just above their middle."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy import ndimage

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary
from ndf_plugin_gaussians.moving_planes import MovingPlanes
from ndf_plugin_gaussians.solid import OFFSET, Solid, meshed, without_crumbs

_REACH = 4.5
"""Nodes deeper below the boundary, in cells, are inside for certain."""
_ABOVE = 0.3
"""Cells from the middle of the splats to the new boundary: room for two nodes inside of the thinnest part."""
_FAIRING = 0.6
"""Standard deviation in cells that the new field is smoothed with."""
_CLIP = 2.0


def fitted_solid(
    solid: Solid, field: Float[Array, "x y z"], grid: Grid, planes: MovingPlanes, min_component: float
) -> Solid:
    """The zero set of the height above the splats' planes, within the solid.

    A base mesh close to the surface leaves the displacement field little to do, so that it can be one-to-one.

    Args:
        solid, field: as `density_solid` made them; positive inside.
        grid: of the field.
        planes: of the visible splats.
        min_component: as for `density_solid`.
    """
    boundary = Boundary(solid)
    inside = np.argwhere(field > 0)
    shallow = np.asarray(ndimage.distance_transform_edt(field > 0))[field > 0] <= _REACH
    nodes = inside[shallow]
    points = grid.nodes(nodes)
    depth, guide = boundary.closest(points)
    height, _, known = planes.at(points, guide)
    cells = np.where(known, height / grid.step, OFFSET - depth / grid.step) - _ABOVE
    drawn = np.where(field > 0, -_CLIP, _CLIP)
    drawn[tuple(nodes.T)] = np.clip(cells, -_CLIP, _CLIP)
    drawn, _ = without_crumbs(-ndimage.gaussian_filter(drawn, _FAIRING), min_component)
    return meshed(drawn, grid, solid.notes, _ABOVE * grid.step)
