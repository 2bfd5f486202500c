"""How steep a field is whose Lipschitz bound nobody knows."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.surfaces.box import Box
from ndf_core.surfaces.foot_points import foot_points
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_core.surfaces.newton import TOLERANCE

SAFETY = 1.5
"""Estimated Lipschitz bounds are the largest value seen times this."""
_STEPS = 24


class Slopes(NamedTuple):
    """How phi grows, as far as samples show."""

    lipschitz: float
    """|phi| over distance to the surface is at most this, with a margin."""
    typical: float
    """The median of that ratio, without a margin."""
    at_surface: float
    """Median of the gradient's length on the surface."""


def estimated_slopes(field: ImplicitField, points: Float[Tensor, "n 3"]) -> Slopes | None:
    """Project points, compare |phi| with how far they went; None where none arrived.

    The largest gradient would bound |phi| too, but a function may be steep where it does not matter: in the middle
    of a ball, say, with a pattern on its angles.
    """
    feet = foot_points(field, points, field.bounds.longest_side, 1, _STEPS)
    distance = (feet.points - points).square().sum(dim=1).sqrt()
    known = (feet.errors <= TOLERANCE * field.bounds.longest_side) & (distance > 0)
    if not bool(known.any()):
        return None
    ratios = (field.values(points).abs() / distance)[known]
    at_surface = feet.gradients[known].square().sum(dim=1).sqrt().median()
    return Slopes(float(ratios.max()) * SAFETY, float(ratios.median()), float(at_surface))


def uniform_points(box: Box, count: int) -> Float[Tensor, "n 3"]:
    """Points spread evenly over a box, the same at every call."""
    generator = torch.Generator().manual_seed(0)
    lower, upper = torch.from_numpy(box.lower), torch.from_numpy(box.upper)
    return lower + torch.rand(count, 3, generator=generator, dtype=torch.float64) * (upper - lower)
