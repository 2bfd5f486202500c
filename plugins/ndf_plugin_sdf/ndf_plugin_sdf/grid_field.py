"""An interpolated volume as an `ImplicitField`."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy import ndimage
from torch import Tensor

from ndf_core.kernels.volume import sample_volume
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_plugin_sdf.volumes.volume import Volume

_SLACK = 1.5
"""Voxels: half of one from a point to its nearest, and one that the spline may swing beyond a change of sign."""

_AROUND = np.ones((3, 3, 3), dtype=bool)

Interpolation = Literal["b_spline", "catmull_rom", "linear"]


class GridField(ImplicitField):
    """phi through the values of the voxels. Evaluated on the CPU whatever the device of the query."""

    block = 1 << 18
    has_plateaus = True
    rounding = 1e-7  # coefficients are in single precision

    def __init__(self, volume: Volume, interpolation: Interpolation) -> None:
        """Take a volume that is negative inside; `lipschitz` is for the caller to set."""
        self._origin = volume.origin
        self._to_index = np.linalg.inv(volume.matrix)
        self._shortest_step = float(np.linalg.svd(volume.matrix, compute_uv=False).min())
        self._kind: Interpolation = interpolation
        self._values = volume.values
        self._coefficients = _coefficients(volume.values, interpolation)
        self.bounds = Box.around(volume.corners)
        self.lipschitz = 1.0

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        return self.evaluate_with_gradient(points)[0]

    def evaluate_with_gradient(
        self, points: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        index = (points.detach().cpu().numpy() - self._origin) @ self._to_index.T
        values, gradients = sample_volume(self._coefficients, np.ascontiguousarray(index), self._kind)
        return torch.from_numpy(values).to(points), torch.from_numpy(gradients @ self._to_index).to(points)

    def clearance(self, points: Float[Tensor, "n 3"], values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        index = np.rint((points.detach().cpu().numpy() - self._origin) @ self._to_index.T).astype(np.int64)
        index = np.clip(index, 0, np.array(self._values.shape) - 1)
        free = self._shortest_step * (self._voxels_away[tuple(index.T)] - _SLACK)
        return torch.maximum(super().clearance(points, values), torch.from_numpy(free).to(values))

    @cached_property
    def _voxels_away(self) -> Int[Array, "x y z"]:
        """Steps, diagonal ones as well, from each voxel to one with a neighbour of the other sign."""
        inside = self._values < 0
        away = np.asarray(ndimage.binary_dilation(inside, _AROUND)) == 0
        away |= np.asarray(ndimage.binary_erosion(inside, _AROUND, border_value=1)) != 0
        return np.asarray(ndimage.distance_transform_cdt(away, "chessboard"))


def _coefficients(values: Float[Array, "x y z"], interpolation: Interpolation) -> Float[Array, "u v w"]:
    """What the interpolant is a sum of, with one layer around it: mirrored, as the spline's ends are."""
    if interpolation == "b_spline":
        # Its declaration says float64, its documentation any type.
        values = ndimage.spline_filter(values, 3, output=np.float32, mode="mirror")  # pyright: ignore[reportArgumentType]
    return np.pad(values, 1, mode="reflect")
