"""Sphere, box, rounded box and plane, as exact signed distances."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator
from torch import Tensor

from ndf_core.surfaces.box import Box
from ndf_plugin_sdf.csg.arithmetic import length
from ndf_plugin_sdf.csg.node import ORIGIN, Length, Lengths, Number, Primitive, Vector, column


class Sphere(Primitive):
    """A ball."""

    type: Literal["sphere"]
    radius: Length = Field(description="radius")
    center: Vector = Field(ORIGIN, description="centre")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return length(points - column(self.center, points)) - self.radius

    def extent(self) -> Box:
        return Box.around(np.array([self.center]), self.radius)


class Cuboid(Primitive):
    """A box with sharp edges, parallel to the axes."""

    type: Literal["box"]
    size: Lengths = Field(description="full side lengths along x, y and z")
    center: Vector = Field(ORIGIN, description="centre")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return _box_distance(points - column(self.center, points), np.array(self.size) / 2)

    def extent(self) -> Box:
        half = np.array(self.size) / 2
        return Box(np.array(self.center) - half, np.array(self.center) + half)


class RoundedBox(Primitive):
    """A box whose edges and corners are rounded off inside `size`."""

    type: Literal["rounded_box"]
    size: Lengths = Field(description="full side lengths along x, y and z, rounding included")
    radius: Length = Field(description="radius of the edges; at most half of the shortest side")
    center: Vector = Field(ORIGIN, description="centre")

    @model_validator(mode="after")
    def _fits(self) -> RoundedBox:
        if self.radius > min(self.size) / 2:
            raise ValueError(f"radius {self.radius:g} is more than half of the shortest side, {min(self.size):g}")
        return self

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        core = np.array(self.size) / 2 - self.radius
        return _box_distance(points - column(self.center, points), core) - self.radius

    def extent(self) -> Box:
        half = np.array(self.size) / 2
        return Box(np.array(self.center) - half, np.array(self.center) + half)


class Plane(Primitive):
    """The half space ``normal . x <= offset * |normal|``: solid on the side that the normal points away from."""

    type: Literal["plane"]
    normal: Vector = Field(description="outward direction, of any length")
    offset: Number = Field(0.0, description="distance of the plane from the origin along the normal")

    @model_validator(mode="after")
    def _has_direction(self) -> Plane:
        if not any(self.normal):
            raise ValueError("normal must not be zero")
        return self

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        normal = np.array(self.normal)
        return (points * column(normal / np.linalg.norm(normal), points)).sum(dim=0) - self.offset

    def extent(self) -> Box:
        box = Box.everywhere()
        axes = np.flatnonzero(self.normal)
        if len(axes) == 1:
            axis = int(axes[0])
            if self.normal[axis] > 0:
                box.upper[axis] = self.offset
            else:
                box.lower[axis] = -self.offset
        return box


def _box_distance(points: Float[Tensor, "3 n"], half: Float[np.ndarray, "3"]) -> Float[Tensor, " n"]:
    """Signed distance of the box [-half, half]."""
    beyond = points.abs() - column(half, points)
    x, y, z = beyond.unbind()
    return length(beyond.clamp_min(0.0)) + x.maximum(y).maximum(z).clamp_max(0.0)
