"""Motions that a surface should follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


@dataclass(frozen=True)
class Motion:
    """x -> scale * rotation x + translation, in input units."""

    name: str
    rotation: Float[Array, "3 3"]
    scale: float
    translation: Float[Array, "3"]

    def apply(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Move points."""
        return self.scale * points @ self.rotation.T + self.translation

    def turn(self, directions: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Turn unit vectors."""
        return directions @ self.rotation.T


def _turned(axis: tuple[float, float, float], degrees: float) -> Float[Array, "3 3"]:
    """Rotation about an axis (Rodrigues)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


_QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_AWAY = np.array([10.0, -20.0, 5.0])

RIGID_MOTIONS = (
    Motion("turned by 40 degrees about (1, 2, 3) and moved", _turned((1.0, 2.0, 3.0), 40.0), 1.0, _AWAY),
    Motion("turned by a quarter about z and moved", _QUARTER, 1.0, _AWAY),
    Motion("moved", np.eye(3), 1.0, _AWAY),
)
"""The hardest first; the first that the format can express is tried."""
SCALING = Motion("scaled by 100", np.eye(3), 100.0, np.zeros(3))
