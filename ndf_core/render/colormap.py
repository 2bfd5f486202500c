"""Perceptual colour maps: two published ones as polynomials, one of our own as a short table."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float, Shaped
from numpy import ndarray as Array

ColormapName = Literal["viridis", "turbo", "heat"]
"""`heat` runs from the clay's paleness to dark red, ever darker: for errors painted on shaded surfaces."""

_TABLES: dict[str, list[str]] = {
    "heat": ["f3ede2", "fadfb1", "fbbc76", "f48b4a", "de5530", "b42430", "7a0d2e", "420621"],
}
"""sRGB in hexadecimal at equal steps, linear in between."""

# Within a few thousandths of the published tables. Coefficients of 1, t, t^2, ... of red, green and blue in sRGB.
_POLYNOMIALS: dict[str, list[list[float]]] = {
    # Fitted by Matt Zucker (public domain) to viridis by Smith, van der Walt and Firing (CC0).
    "viridis": [
        [0.2777273272234177, 0.005407344544966578, 0.3340998053353061],
        [0.1050930431085774, 1.404613529898575, 1.384590162594685],
        [-0.3308618287255563, 0.214847559468213, 0.09509516302823659],
        [-4.634230498983486, -5.799100973351585, -19.33244095627987],
        [6.228269936347081, 14.17993336680509, 56.69055260068105],
        [4.776384997670288, -13.74514537774601, -65.35303263337234],
        [-5.435455855934631, 4.645852612178535, 26.3124352495832],
    ],
    # Mikhailov, "Turbo, an improved rainbow colormap for visualization" (Apache 2.0).
    "turbo": [
        [0.13572138, 0.09140261, 0.10667330],
        [4.61539260, 2.19418839, 12.64194608],
        [-42.66032258, 4.84296658, -60.58204836],
        [132.13108234, -14.18503333, 110.36276771],
        [-152.94239396, 4.27729857, -89.90310912],
        [59.28637943, 2.82956604, 27.34824973],
    ],
}


def colormap(
    values: Shaped[Array, "*shape"], vmin: float | int, vmax: float | int, name: ColormapName = "viridis"
) -> Float[Array, "*shape 3"]:
    """sRGB colours in [0, 1] of values between `vmin` and `vmax`; values beyond get the end's colour, NaN grey.

    Raises:
        ValueError: `vmin` is not below `vmax`.
    """
    if not vmin < vmax:
        raise ValueError(f"colormap: vmin must be below vmax, got {vmin} and {vmax}")
    values = np.asarray(values, dtype=np.float64)
    t = np.clip((values - vmin) / (vmax - vmin), 0.0, 1.0)[..., None]
    color = _interpolated(_TABLES[name], t) if name in _TABLES else _polynomial(_POLYNOMIALS[name], t)
    return np.where(np.isnan(t), 0.5, np.clip(color, 0.0, 1.0))


def _polynomial(coefficients: list[list[float]], t: Float[Array, "*shape 1"]) -> Float[Array, "*shape 3"]:
    color = np.zeros((*t.shape[:-1], 3))
    for coefficient in reversed(coefficients):
        color = color * t + coefficient
    return color


def _interpolated(table: list[str], t: Float[Array, "*shape 1"]) -> Float[Array, "*shape 3"]:
    colors = np.array([list(bytes.fromhex(entry)) for entry in table]) / 255
    steps = np.arange(len(table)) / (len(table) - 1)
    return np.stack([np.interp(t[..., 0], steps, channel) for channel in colors.T], axis=-1)
