"""Numbers on a grid as an implicit field, by trilinear interpolation."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.surfaces.box import Box
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_plugin_gaussians.grid import Grid

_STEEPEST = 2.0
"""Bound of |phi| over the distance, to be safe: the numbers are distances."""
_CORNERS = np.array(list(np.ndindex(2, 2, 2)))


class GridField(ImplicitField):
    """phi is the interpolated number; beyond the grid it goes on as at the border.

    Runs on the CPU; points on another device are copied there and back.
    """

    def __init__(self, values: Float[Array, "x y z"], grid: Grid) -> None:
        self._values, self._grid = np.ascontiguousarray(values, dtype=np.float64), grid
        self.bounds = Box(*grid.bounds)
        self.lipschitz = _STEEPEST

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        return self.evaluate_with_gradient(points)[0]

    def evaluate_with_gradient(
        self, points: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        grid = self._grid
        place = (points.detach().to("cpu", torch.float64).numpy() - grid.low) / grid.step
        last = np.array(grid.shape) - 2
        first = np.clip(np.floor(np.nan_to_num(place)), 0, last).astype(np.int64)
        share = np.clip(place - first, 0.0, 1.0)
        stride = np.array([grid.shape[1] * grid.shape[2], grid.shape[2], 1])
        around = self._values.reshape(-1)[(first @ stride)[:, None] + _CORNERS @ stride].reshape(-1, 2, 2, 2)
        x, y, z = (share[:, i, None] for i in range(3))
        # Along z, then y, then x; the slope along an axis is interpolated along the others.
        along_z = around[..., 0] + z[..., None] * (around[..., 1] - around[..., 0])
        slope_z = around[..., 1] - around[..., 0]
        along_y = along_z[..., 0] + y * (along_z[..., 1] - along_z[..., 0])
        slope_y = along_z[..., 1] - along_z[..., 0]
        slope_z = slope_z[..., 0] + y * (slope_z[..., 1] - slope_z[..., 0])
        values = along_y[:, 0] + x[:, 0] * (along_y[:, 1] - along_y[:, 0])
        gradient = np.stack(
            [
                along_y[:, 1] - along_y[:, 0],
                slope_y[:, 0] + x[:, 0] * (slope_y[:, 1] - slope_y[:, 0]),
                slope_z[:, 0] + x[:, 0] * (slope_z[:, 1] - slope_z[:, 0]),
            ],
            axis=1,
        )
        return torch.from_numpy(values).to(points), torch.from_numpy(gradient / grid.step).to(points)
