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

from ndf_plugin_sdf.csg.box import Box
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

    def extent(self) -> Box:
        return Box(np.subtract(self.center, self.radii), np.add(self.center, self.radii))


def _closest(points: Float[Tensor, "3 n"], radii: Float[Tensor, "3 1"]) -> Float[Tensor, "3 n"]:
    """Closest point of the ellipsoid about the origin: x r^2 / (t + r^2) with t the largest root of F.

    F(t) = sum (r x / (t + r^2))^2 - 1 falls and is convex right of its last pole -min(r)^2, so Newton started left of
    the root climbs to it without overshooting. Where one summand alone reaches 1 is such a start, with F <= 2. The
    unknown is s = t + min(r)^2 > 0, free of cancellation; the excess r^2 - min(r)^2 is added per axis. A column stops
    for good at its first step without progress, so its answer does not depend on the other columns.

    Reference: D. Eberly, Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid.
    """
    smallest = radii.min()
    excess = (radii - smallest) * (radii + smallest)
    # On a plane of symmetry inside, the closest point leaves the plane: a hair's breadth off it picks one side.
    away = torch.where(points < 0, -1.0, 1.0) * points.abs().maximum(radii * 1e-14)
    reach = radii * away.abs()
    s = (reach - excess).amax(dim=0)
    for _ in range(64):
        ratio = reach / (s + excess)
        excessive = ratio.square().sum(dim=0) - 1.0
        slope = 2.0 * (ratio.square() / (s + excess)).sum(dim=0)
        following = s + excessive / slope
        moving = following > s * (1.0 + 1e-15)
        if not bool(moving.any()):
            break
        s = torch.where(moving, following, s)
    return away * radii.square() / (s + excess)
