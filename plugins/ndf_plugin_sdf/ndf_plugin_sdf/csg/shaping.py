"""Changing a solid's form: round, shell, ripple, twist."""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from pydantic import Field
from torch import Tensor

from ndf_core.surfaces.box import Box
from ndf_plugin_sdf.csg.node import Length, Modifier, Number


class Round(Modifier):
    """The child, grown by a radius: its convex edges become round."""

    type: Literal["round"]
    radius: Length = Field(description="how far its surface moves outwards")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return self.child.distance(points) - self.radius

    def bounds(self, level: float = 0.0) -> Box:
        return self.child.bounds(level + self.radius)


class Shell(Modifier):
    """A wall on the child's surface, half of its thickness to either side; hollow inside."""

    type: Literal["shell"]
    thickness: Length = Field(description="thickness of the wall")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return self.child.distance(points).abs() - self.thickness / 2

    def bounds(self, level: float = 0.0) -> Box:
        return self.child.bounds(level + self.thickness / 2)


class Ripple(Modifier):
    """The child with an egg-box pattern: amplitude * sin(kx) sin(ky) sin(kz), k = 2 pi / wavelength, outwards."""

    type: Literal["ripple"]
    amplitude: Length = Field(description="height of the pattern's bumps, and depth of its dents")
    wavelength: Length = Field(description="distance at which the pattern repeats along each axis")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        waves = (points * (2.0 * np.pi / self.wavelength)).sin()
        return self.child.distance(points) - self.amplitude * waves[0] * waves[1] * waves[2]

    def bounds(self, level: float = 0.0) -> Box:
        return self.child.bounds(level + self.amplitude)

    def lipschitz(self, domain: Box) -> float:
        # The squared gradient of sin a sin b sin c is multilinear in u = sin^2 a, v, w, so its maximum over [0, 1]^3
        # is at a corner: 1, where two of them are 1 and the third is 0.
        return self.child.lipschitz(domain) + 2.0 * np.pi * self.amplitude / self.wavelength


class Twist(Modifier):
    """The child, turned about the z axis by an angle that grows with z (a screw)."""

    type: Literal["twist"]
    rate: Number = Field(description="angle per unit of length along z")
    unit: Literal["degrees", "radians"] = Field("degrees", description="unit of the angle in `rate`")

    @property
    def radians(self) -> float:
        return self.rate * (np.pi / 180.0 if self.unit == "degrees" else 1.0)

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        x, y, z = points.unbind()
        cosine, sine = (z * self.radians).cos(), (z * self.radians).sin()
        return self.child.distance(torch.stack([cosine * x + sine * y, cosine * y - sine * x, z]))

    def bounds(self, level: float = 0.0) -> Box:
        return swept(self.child.bounds(level))

    def lipschitz(self, domain: Box) -> float:
        # In cylinder coordinates at radius r the twist's Jacobian is a rotation times [[1, s], [0, 1]], s = rate r,
        # whose largest singular value is (s + sqrt(s^2 + 4)) / 2.
        disc = swept(domain)
        shear = abs(self.radians) * float(disc.upper[0])
        return self.child.lipschitz(disc) * (shear + np.hypot(shear, 2.0)) / 2.0


def swept(box: Box) -> Box:
    """The box of what `box` sweeps when it turns about the z axis."""
    if box.empty:
        return box
    radius = np.hypot(*np.maximum(np.abs(box.lower[:2]), np.abs(box.upper[:2])))
    return Box(np.array([-radius, -radius, box.lower[2]]), np.array([radius, radius, box.upper[2]]))
