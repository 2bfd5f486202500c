"""Closest points of ellipses."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

_STEPS = 8
_THINNEST = 1e-9
"""Of half axes, as a share of the place's distance: thinner ones are a line, or a point."""


def within_ellipse(places: Float[Array, "n 2"], half_axes: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
    """The point of each filled ellipse, centred and along the axes, that is closest to a place.

    Outside it is a^2 p / (a^2 + t) along each axis, with the t >= 0 that puts it on the ellipse. The equation for t
    is convex and decreasing, so Newton's method never steps too far from where either axis alone would be satisfied.

    Args:
        places: relative to the middle.
        half_axes: one pair for each, not negative.
    """
    squares = np.maximum(half_axes, _THINNEST * np.linalg.norm(places, axis=1, keepdims=True) + 1e-150) ** 2
    outside = (places**2 / squares).sum(axis=1) > 1
    place, square = places[outside], squares[outside]
    t = (np.sqrt(square) * np.abs(place) - square).max(axis=1, keepdims=True).clip(min=0)
    for _ in range(_STEPS):
        terms = square * place**2 / (square + t) ** 2
        excess = terms.sum(axis=1, keepdims=True) - 1
        t = t + excess / (2 * (terms / (square + t)).sum(axis=1, keepdims=True))
    found = places.copy()
    found[outside] = square * place / (square + t)
    return found
