"""How steep a field is whose Lipschitz bound nobody knows."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.surfaces.foot_points import foot_points
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_core.surfaces.newton import TOLERANCE

SAFETY = 1.5
"""Estimated Lipschitz bounds are the largest value seen times this."""
_STEPS = 24


def estimated_lipschitz(field: ImplicitField, points: Float[Tensor, "n 3"]) -> float | None:
    """Largest |phi| over distance to the surface, as far as the points show, with a margin; None if none projects.

    The largest gradient would do too, but a function may be steep where it does not matter: in the middle of a
    ball, say, with a pattern on its angles.
    """
    feet = foot_points(field, points, field.bounds.longest_side, 1, _STEPS)
    distance = (feet.points - points).square().sum(dim=1).sqrt()
    known = (feet.errors <= TOLERANCE * field.bounds.longest_side) & (distance > 0)
    ratios = (field.values(points).abs() / distance)[known]
    return float(ratios.max()) * SAFETY if len(ratios) else None


def uniform_points(field: ImplicitField, count: int) -> Float[Tensor, "n 3"]:
    """Points spread evenly over the bounds, the same at every call."""
    generator = torch.Generator().manual_seed(0)
    lower, upper = (torch.from_numpy(end) for end in (field.bounds.lower, field.bounds.upper))
    return lower + torch.rand(count, 3, generator=generator, dtype=torch.float64) * (upper - lower)
