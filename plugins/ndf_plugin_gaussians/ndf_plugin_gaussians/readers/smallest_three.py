"""Unit quaternions stored as their three smallest components and the place of the largest."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


def from_smallest_three(components: Float[Array, "n 3"], largest: Int[Array, " n"]) -> Float[Array, "n 4"]:
    """Quaternions with `components` in the order of their places, and the rest of the unit length, positive, at the
    place `largest` (0 to 3)."""
    quaternions = np.empty((len(components), 4))
    rows = np.arange(len(components))
    quaternions[rows[:, None], _OTHERS[largest]] = components
    quaternions[rows, largest] = np.sqrt(np.maximum(0.0, 1.0 - (components**2).sum(axis=1)))
    return quaternions
