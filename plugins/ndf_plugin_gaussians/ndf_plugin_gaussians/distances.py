"""The surface of splats as numbers on a grid: distances from it, negative inside."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy import ndimage

from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary

_REACH = 4.0
"""Cells up to which distances are those from the triangles; beyond, those between nodes."""


def signed_distances(inside: Float[Array, "x y z"], grid: Grid, boundary: Boundary) -> Float[Array, "x y z"]:
    """Distance of every node from the boundary in input units, negative where `inside` is positive.

    Args:
        inside: positive inside.
        grid: of all arrays.
        boundary: its zero level set.
    """
    solid = inside > 0
    below = np.asarray(ndimage.distance_transform_edt(solid))
    above = np.asarray(ndimage.distance_transform_edt(~solid))
    field = (above - below - np.where(solid, -0.5, 0.5)) * grid.step
    nodes = np.argwhere(np.where(solid, below, above) <= _REACH)
    near = tuple(nodes.T)
    field[near] = np.where(solid[near], -1.0, 1.0) * boundary.closest(grid.nodes(nodes))[0]
    return field
