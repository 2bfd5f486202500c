"""Frames whose first axis is given."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


def axes_of(normals: Float[Array, "n 3"]) -> Float[Array, "n 3 3"]:
    """Right-handed frames of unit columns, each normal first."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    across = np.cross(normals, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([normals, across, np.cross(normals, across)], axis=2)
