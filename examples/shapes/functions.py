"""Solids as Python functions: a fluted trefoil knot and a ball of gyroid.

ndf fit examples/shapes/functions.py:trefoil -o trefoil.ndf
ndf fit examples/shapes/functions.py:gyroid_ball -o gyroid.ndf

Each takes points (n, 3), float64, as a torch tensor, and returns (n,) values, negative inside.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

RING, COIL, ROPE = 1.0, 0.45, 0.24
"""Radii: of the ring that the knot winds around, of its winding, of the rope."""
FLUTES, FLUTE_DEPTH = 5, 0.035


def trefoil(points: Tensor) -> Tensor:
    """A rope in a trefoil knot: it runs twice around the z axis while it coils three times around the ring.

    Every half plane of the axis cuts the rope twice, at opposite places of a circle; both turn by 3/2 of the half
    plane's angle. The field is the distance to the nearer cut: a bound, since the rope crosses at a slant.
    """
    x, y, z = points.unbind(dim=1)
    around = torch.atan2(y, x)
    across = torch.hypot(x, y) - RING
    # Polar coordinates about each cut, and the angle that its flutes turn by along the rope.
    fields = []
    for strand in (0, 1):
        angle = 1.5 * around + math.pi * strand
        u, v = across - COIL * torch.cos(angle), z - COIL * torch.sin(angle)
        distance = torch.hypot(u, v).clamp_min(1e-9)
        twist = torch.atan2(v, u) - angle
        # In the middle of the rope the angle jumps, so the flutes fade out towards it.
        depth = FLUTE_DEPTH * (distance / ROPE).clamp_max(1.0) ** 2
        fields.append(distance - ROPE + depth * torch.cos(FLUTES * twist))
    return torch.minimum(*fields)


trefoil.bounds = [[-1.8, -1.8, -0.8], [1.8, 1.8, 0.8]]


def gyroid_ball(points: Tensor) -> Tensor:
    """A wall along the gyroid, cut out of a ball, its rims rounded. Genus 26."""
    cell, thickness, radius, rim = 1.6, 0.2, 1.5, 0.06
    x, y, z = (2.0 * math.pi / cell * points).unbind(dim=1)
    level = torch.sin(x) * torch.cos(y) + torch.sin(y) * torch.cos(z) + torch.sin(z) * torch.cos(x)
    # Where it vanishes, the gradient of the level is about 1.5 * 2 pi / cell long: divide by it for lengths.
    wall = level.abs() * cell / (2.0 * math.pi * 1.5) - thickness / 2
    ball = torch.linalg.vector_norm(points, dim=1) - radius
    # The larger of both, but a circular arc of radius `rim` where they meet.
    apart = (wall - ball).abs().clamp_max(rim)
    return torch.where(
        apart < rim,
        0.5 * (wall + ball) - 0.5 * (2.0 * rim**2 - apart**2).sqrt() + rim,
        torch.maximum(wall, ball),
    )


gyroid_ball.bounds = [[-1.6, -1.6, -1.6], [1.6, 1.6, 1.6]]
