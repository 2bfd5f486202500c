"""Torus, capsule, capped cylinder and cone: exact distances of solids of revolution about any axis."""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from pydantic import Field, model_validator
from torch import Tensor

from ndf_core.surfaces.box import Box, hull
from ndf_plugin_sdf.csg.arithmetic import hypotenuse, length
from ndf_plugin_sdf.csg.node import LARGEST, ORIGIN, Length, Primitive, Vector, column


class Torus(Primitive):
    """A ring."""

    type: Literal["torus"]
    major_radius: Length = Field(description="radius of the circle in the middle of the tube")
    minor_radius: Length = Field(description="radius of the tube; below the major radius")
    center: Vector = Field(ORIGIN, description="centre")
    axis: Vector = Field((0.0, 0.0, 1.0), description="axis of revolution, of any length")

    @model_validator(mode="after")
    def _is_ring(self) -> Torus:
        if not any(self.axis):
            raise ValueError("axis must not be zero")
        if self.minor_radius >= self.major_radius:
            raise ValueError("minor_radius must be below major_radius, or the ring has no hole")
        return self

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        along, across = _axial(points, np.array(self.center), _unit(self.axis))
        return hypotenuse(across - self.major_radius, along) - self.minor_radius

    def extent(self) -> Box:
        return _disc(self.center, self.axis, self.major_radius).grown(self.minor_radius)


class _Bar(Primitive):
    """A solid of revolution about the segment from `start` to `end`."""

    start: Vector = Field(description="one end of the axis")
    end: Vector = Field(description="other end of the axis")

    @model_validator(mode="after")
    def _has_length(self) -> _Bar:
        if self.height < 1e-12:
            raise ValueError("start and end must differ")
        return self

    @property
    def height(self) -> float:
        return float(np.linalg.norm(np.subtract(self.end, self.start)))

    def axial(self, points: Float[Tensor, "3 n"]) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
        """Position along the axis from `start`, and distance from the axis."""
        return _axial(points, np.array(self.start), np.subtract(self.end, self.start) / self.height)


class Capsule(_Bar):
    """A segment thickened by a radius, with round ends."""

    type: Literal["capsule"]
    radius: Length = Field(description="radius")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        along, across = self.axial(points)
        return hypotenuse(along - along.clamp(0.0, self.height), across) - self.radius

    def extent(self) -> Box:
        return Box.around(np.array([self.start, self.end]), self.radius)


class CappedCylinder(_Bar):
    """A cylinder with flat ends."""

    type: Literal["capped_cylinder"]
    radius: Length = Field(description="radius")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        along, across = self.axial(points)
        side, cap = across - self.radius, (along - self.height / 2).abs() - self.height / 2
        return hypotenuse(side.clamp_min(0.0), cap.clamp_min(0.0)) + side.maximum(cap).clamp_max(0.0)

    def extent(self) -> Box:
        axis = tuple(np.subtract(self.end, self.start))
        return hull(_disc(end, axis, self.radius) for end in (self.start, self.end))


class Cone(_Bar):
    """A cone, or its frustum, with flat ends."""

    type: Literal["cone"]
    start_radius: Length = Field(description="radius at start")
    end_radius: float = Field(0.0, strict=True, allow_inf_nan=False, ge=0, le=LARGEST, description="radius at end")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        along, across = self.axial(points)
        height, wide, narrow = self.height, self.start_radius, self.end_radius
        slant = float(np.hypot(height, wide - narrow))
        # Half of the profile is a convex quadrilateral: inside, the distance is that of the nearest line; outside,
        # that of the edge that the point faces, or of a corner. Signed lines, rather than sign times length, keep the
        # gradient right on the surface itself.
        side = ((across - wide) * height + along * (wide - narrow)) / slant
        cap = (along - height / 2).abs() - height / 2
        corner = torch.minimum(hypotenuse(across - wide, along), hypotenuse(across - narrow, along - height))
        position = ((across - wide) * (narrow - wide) + along * height) / slant**2
        faces_side = (position >= 0) & (position <= 1) & (side >= 0)
        faces_cap = (across <= torch.where(along > height / 2, narrow, wide)) & (cap >= 0)
        outside = torch.where(faces_side, side, torch.where(faces_cap, cap, corner))
        inner = side.maximum(cap)
        return torch.where(inner <= 0, inner, outside)

    def extent(self) -> Box:
        axis = tuple(np.subtract(self.end, self.start))
        return hull([_disc(self.start, axis, self.start_radius), _disc(self.end, axis, self.end_radius)])


def _unit(vector: Vector) -> Float[np.ndarray, "3"]:
    return np.array(vector) / np.linalg.norm(vector)


def _axial(
    points: Float[Tensor, "3 n"], start: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]
) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """Coordinate along a unit axis, and distance from it."""
    relative, direction = points - column(start, points), column(axis, points)
    along = (relative * direction).sum(dim=0)
    return along, length(relative - direction * along)


def _disc(center: Vector, axis: tuple[float, ...], radius: float) -> Box:
    """Box of a flat disc: along x it reaches radius * sqrt(1 - axis_x^2)."""
    direction = np.array(axis) / np.linalg.norm(axis)
    reach = radius * np.sqrt(np.clip(1.0 - direction**2, 0.0, 1.0))
    return Box(np.array(center) - reach, np.array(center) + reach)
