"""A perspective camera, and the framing that fits points into its picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

View = tuple[float | int, float | int]
"""Azimuth and elevation in degrees: (0, 0) looks at the front, (90, 0) at the right-hand side, (0, 90) from above."""


@dataclass(frozen=True)
class Camera:
    """Pinhole camera in the frame and units of the mesh."""

    eye: Float[Array, "3"]
    axes: Float[Array, "3 3"]
    """Orthonormal rows: right, up, and back (from the scene towards the eye)."""
    tangent: float
    """Tangent of half the vertical field of view."""

    @staticmethod
    def framing(
        points: Float[Array, "n 3"],
        view: View = (30.0, 20.0),
        *,
        aspect: float = 1.0,
        up: Literal["y", "z"] = "y",
        margin: float = 0.06,
        field_of_view: float = 24.0,
    ) -> Camera:
        """The closest camera from this side that sees all of `points`, such as a mesh's vertices or a box's corners.

        Args:
            points: what to fit. Give all panels of one shape the same points, or one camera.
            view: azimuth and elevation in degrees.
            aspect: width of the picture over its height.
            up: the axis that points up; the front is +z when y is up, and -y when z is up.
            margin: share of the picture left free on each side.
            field_of_view: vertical, in degrees.

        A point p = (x, y, z) in camera axes is within the picture's height when |y - y0| <= t (D - z) for the eye at
        height y0 and distance D. That is D >= max(z + y/t) - y0/t and D >= max(z - y/t) + y0/t, whose smallest D is
        the mean of the two maxima. The same holds for the width.
        """
        axes = _axes(view, up)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        x, y, z = axes @ (points - middle).T
        tangent = float(np.tan(np.radians(field_of_view) / 2))
        inner = tangent * (1 - 2 * margin)
        centers: list[float] = []
        distances: list[float] = []
        for offset, slope in ((x, inner * aspect), (y, inner)):
            high, low = float((z + offset / slope).max()), float((z - offset / slope).max())
            centers.append(slope * (high - low) / 2)
            distances.append((high + low) / 2)
        size = float(np.ptp(points, axis=0).max()) or 1.0
        distance = max(*distances, float(z.max()) + 1e-3 * size)
        return Camera(middle + np.array([*centers, distance]) @ axes, axes, tangent)

    def rays(
        self, columns: Float[Array, " n"], rows: Float[Array, " n"], width: int, height: int
    ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
        """Origins and directions through picture positions in pixels: (0, 0) is the upper left corner of the picture.

        Directions have length 1 along the viewing axis, so that a ray's t is depth.
        """
        x = (2 * columns / width - 1) * self.tangent * width / height
        y = (1 - 2 * rows / height) * self.tangent
        directions = np.stack([x, y, np.full_like(x, -1.0)], axis=1) @ self.axes
        return np.broadcast_to(self.eye, directions.shape), directions

    def project(self, points: Float[Array, "n 3"], width: int, height: int) -> Float[Array, "n 2"]:
        """Picture positions (column, row) in pixels; the inverse of `rays` for points in front of the eye."""
        x, y, z = self.axes @ (points - self.eye).T
        depth = np.maximum(-z, 1e-300)
        column = (x / (depth * self.tangent * width / height) + 1) * width / 2
        row = (1 - y / (depth * self.tangent)) * height / 2
        return np.stack([column, row], axis=1)


def _axes(view: View, up: Literal["y", "z"]) -> Float[Array, "3 3"]:
    azimuth, elevation = np.radians(view)
    right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    level = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    back = np.cos(elevation) * level + np.sin(elevation) * np.array([0.0, 1.0, 0.0])
    axes = np.stack([right, np.cross(back, right), back])
    # From y up, front +z, to z up, front -y.
    return axes if up == "y" else np.stack([axes[:, 0], -axes[:, 2], axes[:, 1]], axis=1)
