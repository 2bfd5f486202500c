"""The readable version of `kernels/volume.py`: one point at a time, sums over the four coefficients of each axis."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.kernels.volume import Kind

_POLYNOMIALS: dict[Kind, list[list[float]]] = {
    # One row per coefficient: powers of t, the highest first.
    "linear": [[0, 0, 0, 0], [0, 0, -1, 1], [0, 0, 1, 0], [0, 0, 0, 0]],
    "catmull_rom": [[-0.5, 1, -0.5, 0], [1.5, -2.5, 0, 1], [-1.5, 2, 0.5, 0], [0.5, -0.5, 0, 0]],
    "b_spline": [[-1 / 6, 0.5, -0.5, 1 / 6], [0.5, -1, 0, 2 / 3], [-0.5, 0.5, 0.5, 1 / 6], [1 / 6, 0, 0, 0]],
}


def sample_volume(
    coefficients: Float[Array, "x y z"], points: Float[Array, "n 3"], kind: Kind
) -> tuple[Float[Array, " n"], Float[Array, "n 3"]]:
    """See `ndf_core.kernels.volume.sample_volume`."""
    answers = [_at(coefficients, point, kind) for point in points]
    return np.array([value for value, _ in answers]), np.array([gradient for _, gradient in answers]).reshape(-1, 3)


def _at(coefficients: Float[Array, "x y z"], point: Float[Array, "3"], kind: Kind) -> tuple[float, Float[Array, "3"]]:
    last = np.array(coefficients.shape) - 3
    inside = np.clip(point, 0, last)
    cell = np.minimum(np.floor(inside), last - 1).astype(int)
    weight = [[np.polyval(row, t) for row in _POLYNOMIALS[kind]] for t in inside - cell]
    slope = [[np.polyval(np.polyder(np.array(row)), t) for row in _POLYNOMIALS[kind]] for t in inside - cell]
    value, gradient = 0.0, np.zeros(3)
    for taps in itertools.product(range(4), repeat=3):
        coefficient = float(coefficients[tuple(cell + taps)])
        value += coefficient * np.prod([weight[axis][tap] for axis, tap in enumerate(taps)])
        for along in range(3):
            factors = [(slope if axis == along else weight)[axis][tap] for axis, tap in enumerate(taps)]
            gradient[along] += coefficient * np.prod(factors)
    return float(value + gradient @ (point - inside)), gradient
