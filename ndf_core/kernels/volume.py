"""Interpolation of a volume: the interface of `src/volume.c`."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.kernels import _volume  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub

Kind = Literal["linear", "catmull_rom", "b_spline"]
KINDS: tuple[Kind, ...] = ("linear", "catmull_rom", "b_spline")


def sample_volume(
    coefficients: Float[Array, "x y z"], points: Float[Array, "n 3"], kind: Kind
) -> tuple[Float[Array, " n"], Float[Array, "n 3"]]:
    """Value and gradient at points in voxel coordinates, the first voxel at (0, 0, 0).

    Outside of the voxels the interpolant is continued along its tangent.

    Args:
        coefficients: float32, C-contiguous, with one layer around the voxels; for "b_spline" those of the spline.
        points: float64, C-contiguous.
        kind: "linear" is continuous, "catmull_rom" has a continuous gradient, "b_spline" a continuous curvature.

    Raises:
        ValueError: a point is not finite, or there are fewer than two voxels along an axis.
    """
    values, gradients = np.empty(len(points)), np.empty((len(points), 3))
    sides = (side - 2 for side in coefficients.shape)
    _volume.sample(values, gradients, points, coefficients.reshape(-1), *sides, KINDS.index(kind))
    return values, gradients
