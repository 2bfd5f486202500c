"""The surface of splats as numbers on a grid: nearly distances from it, negative inside."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy import ndimage

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary

_REACH = 4.0
"""Cells up to which distances are those from the triangles; beyond, those between nodes."""
_EXACT = 2.0
"""Cells up to which the given numbers count, so that the zero set stays theirs."""


def like_distances(inside: Float[Array, "x y z"], grid: Grid, boundary: Boundary) -> Float[Array, "x y z"]:
    """Numbers with the zero set of `inside`, that grow about as the distance from it, in input units.

    Distances themselves, interpolated, would round off what is as small as a cell: next to the surface they are
    `inside` times a factor that changes slowly.

    Args:
        inside: positive inside.
        grid: of all arrays.
        boundary: the zero level set of `inside`.
    """
    solid = inside > 0
    below = np.asarray(ndimage.distance_transform_edt(solid))
    above = np.asarray(ndimage.distance_transform_edt(~solid))
    cells = np.where(solid, below, above)
    distance = (cells - 0.5) * grid.step
    near = cells <= _REACH
    distance[near] = boundary.closest(grid.nodes(np.argwhere(near)))[0]
    factor = ndimage.gaussian_filter(near * distance, 1.0) / ndimage.gaussian_filter(
        near * np.abs(inside) + 1e-9, 1.0
    )
    return np.where(solid, -1.0, 1.0) * np.where(cells <= _EXACT, np.abs(inside) * factor, distance)
