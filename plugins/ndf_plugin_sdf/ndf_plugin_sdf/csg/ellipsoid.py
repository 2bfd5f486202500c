"""Ellipsoid: the exact distance, from the closest point.

The usual closed formula, k0 (k0 - 1) / k1, is discontinuous at the centre and its gradient is not bounded by 1.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from pydantic import Field
from torch import Tensor

from ndf_core.surfaces.box import Box
from ndf_plugin_sdf.csg.node import ORIGIN, Lengths, Primitive, Vector, column


class Ellipsoid(Primitive):
    """An ellipsoid with its axes along x, y and z."""

    type: Literal["ellipsoid"]
    radii: Lengths = Field(description="half axes along x, y and z")
    center: Vector = Field(ORIGIN, description="centre")

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        relative = points - column(self.center, points)
        with torch.no_grad():
            radii = column(self.radii, points)
            closest = _closest(relative, radii)
            normal = closest / radii.square()
            normal = normal / normal.square().sum(dim=0).sqrt()
        # The offset from the closest point is parallel to the normal, so its derivative is the normal alone.
        return ((relative - closest) * normal).sum(dim=0)

    @property
    def cost(self) -> int:
        return 6  # Newton's steps

    def extent(self) -> Box:
        return Box(np.subtract(self.center, self.radii), np.add(self.center, self.radii))


def _closest(points: Float[Tensor, "3 n"], radii: Float[Tensor, "3 1"]) -> Float[Tensor, "3 n"]:
    """Closest point of the ellipsoid about the origin: x r^2 / (t + r^2) with t the largest root of F.

    F(t) = sum (r x / (t + r^2))^2 - 1 falls and is convex right of its last pole -min(r)^2, so Newton started left of
    the root climbs to it without overshooting, and from anywhere its first step ends left of the root. One such start
    is where a summand alone reaches 1; another is the step from t = 0, which is almost there for points near the
    surface. The unknown is s = t + min(r)^2 > 0, free of cancellation; the excess r^2 - min(r)^2 is added per axis. A
    column stops for good at its first small step, so its answer does not depend on the other columns.

    Reference: D. Eberly, Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid.
    """
    smallest = radii.min()
    excess = (radii - smallest) * (radii + smallest)
    # On a plane of symmetry inside, the closest point leaves the plane: a hair's breadth off it picks one side.
    away = torch.where(points < 0, -1.0, 1.0) * points.abs().maximum(radii * 1e-14)
    reach = radii * away.abs()
    s = (reach - excess).amax(dim=0).maximum(_newton(smallest.square(), reach, excess))
    moving = torch.ones_like(s, dtype=torch.bool)
    for _ in range(64):
        following = torch.where(moving, _newton(s, reach, excess), s).maximum(s)
        # Convergence is quadratic: after a step of 1e-8 there is nothing left to gain.
        moving &= following > s * (1.0 + 1e-8)
        s = following
        if not bool(moving.any()):
            break
    return away * radii.square() / (s + excess)


def _newton(
    s: Float[Tensor, " n"] | Float[Tensor, ""], reach: Float[Tensor, "3 n"], excess: Float[Tensor, "3 1"]
) -> Float[Tensor, " n"]:
    """One step for F = sum (reach / (s + excess))^2 - 1."""
    inverse = (s + excess).reciprocal()
    squares = (reach * inverse).square()
    return s + 0.5 * (squares.sum(dim=0) - 1.0) / (squares * inverse).sum(dim=0)
