"""Moving a solid: translate, rotate, scale, mirror."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from pydantic import Field, model_validator
from torch import Tensor

from ndf_core.surfaces.box import Box, hull
from ndf_plugin_sdf.csg.node import Length, Lengths, Modifier, Number, Vector, column


class Translate(Modifier):
    """The child, moved."""

    type: Literal["translate"]
    offset: Vector = Field(description="how far along x, y and z")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return self.child.distance(points - column(self.offset, points))

    def bounds(self, level: float = 0.0) -> Box:
        return self.child.bounds(level).moved(np.array(self.offset))

    def lipschitz(self, domain: Box) -> float:
        return self.child.lipschitz(domain.moved(-np.array(self.offset)))


class Rotate(Modifier):
    """The child, turned about the origin: by `angle` about `axis`, or by `euler` about x, y, z in this order."""

    type: Literal["rotate"]
    axis: Vector | None = Field(
        None, description="axis, of any length; the turn is counter-clockwise seen from its tip"
    )
    angle: Number | None = Field(None, description="angle about `axis`")
    euler: Vector | None = Field(None, description="angles about the fixed axes x, y and z, applied in this order")
    unit: Literal["degrees", "radians"] = Field("degrees", description="unit of `angle` and `euler`")

    @model_validator(mode="after")
    def _is_one_turn(self) -> Rotate:
        by_axis = self.axis is not None and self.angle is not None
        if by_axis == (self.euler is not None) or (self.axis is None) != (self.angle is None):
            raise ValueError("give either axis and angle, or euler")
        if self.axis is not None and not any(self.axis):
            raise ValueError("axis must not be zero")
        return self

    @cached_property
    def matrix(self) -> Float[Array, "3 3"]:
        """The rotation; entries that are zero but for rounding are zero, so that quarter turns keep boxes tight."""
        unit = np.pi / 180.0 if self.unit == "degrees" else 1.0
        if self.euler is not None:
            x, y, z = (about(axis, unit * angle) for axis, angle in zip(np.eye(3), self.euler, strict=True))
            matrix = z @ y @ x
        else:
            matrix = about(np.array(self.axis), unit * float(self.angle or 0.0))
        return np.where(np.abs(matrix) < 1e-15, 0.0, matrix)

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return self.child.distance(points.new_tensor(self.matrix.T) @ points)

    def bounds(self, level: float = 0.0) -> Box:
        return self.child.bounds(level).turned(self.matrix)

    def lipschitz(self, domain: Box) -> float:
        return self.child.lipschitz(domain.turned(self.matrix.T))


class Scale(Modifier):
    """The child, enlarged about the origin.

    With different factors per axis the field is a bound: the child's field times the smallest factor.
    """

    type: Literal["scale"]
    factor: Length | Lengths = Field(description="one factor, or one each for x, y and z")

    @property
    def factors(self) -> Float[Array, "3"]:
        return np.broadcast_to(np.array(self.factor, dtype=np.float64), (3,))

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        # |child(x/s) - child(y/s)| <= L |(x - y)/s| <= L |x - y| / min(s): times min(s), the child's own bound holds.
        return self.child.distance(points / column(self.factors, points)) * float(self.factors.min())

    def bounds(self, level: float = 0.0) -> Box:
        return self.child.bounds(level / float(self.factors.min())).scaled(self.factors)

    def lipschitz(self, domain: Box) -> float:
        return self.child.lipschitz(domain.scaled(1.0 / self.factors))


class Mirror(Modifier):
    """The child together with its mirror image in a plane across one axis."""

    type: Literal["mirror"]
    axis: Literal["x", "y", "z"] = Field(description="axis that the mirror plane is orthogonal to")
    offset: Number = Field(0.0, description="where the plane meets the axis")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        signs, shift = (column(vector, points) for vector in self._reflection())
        both = self.child.distance(torch.cat([points, points * signs + shift], dim=1))
        return both.reshape(2, -1).amin(dim=0)

    def bounds(self, level: float = 0.0) -> Box:
        box = self.child.bounds(level)
        return hull([box, self._image(box)])

    def lipschitz(self, domain: Box) -> float:
        return self.child.lipschitz(hull([domain, self._image(domain)]))

    @property
    def cost(self) -> int:
        return 2 * self.child.cost

    def _reflection(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        on_axis = np.array([self.axis == name for name in "xyz"])
        return np.where(on_axis, -1.0, 1.0), np.where(on_axis, 2.0 * self.offset, 0.0)

    def _image(self, box: Box) -> Box:
        signs, shift = self._reflection()
        return box.turned(np.diag(signs)).moved(shift)


def about(axis: Float[Array, "3"], angle: float) -> Float[Array, "3 3"]:
    """Rotation matrix about a direction of any length, in radians (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
