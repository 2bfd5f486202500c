"""A zero near points whose gradient leads to none: look around for the other sign, then close in on the change.

Occupancy-like fields are noise on plateaus, far from the surface and deep inside, and Newton's steps wander there.
"""

from __future__ import annotations

import itertools

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ndf_core.surfaces.implicit_field import ImplicitField

_RADII = tuple(2.0**-k for k in range(8, 3, -1))
"""Shells to look at, as shares of the size, the nearest first."""
_DIRECTIONS = [axis for axis in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(axis)]
_HALVINGS = 12
"""Of the segment between two shells; Newton's steps go on from there."""


def nearest_sign_change(
    field: ImplicitField, query: Float[Tensor, "n 3"], size: float
) -> tuple[Float[Tensor, "n 3"], Bool[Tensor, " n"]]:
    """For each query a point close to a zero of `field`, and whether there is one within a sixteenth of the size.

    Each row takes the nearest shell on which any of 26 directions has the other sign, so the point is up to a few
    tens of per cent farther away than the nearest zero.
    """
    directions = query.new_tensor(_DIRECTIONS)
    directions = directions / directions.square().sum(dim=1, keepdim=True).sqrt()
    inside = field.values(query) < 0
    heading = torch.zeros_like(query)
    near, far = torch.zeros_like(query[:, 0]), torch.zeros_like(query[:, 0])
    left = torch.arange(len(query), device=query.device)
    for previous, radius in itertools.pairwise((0.0, *_RADII)):
        if not len(left):
            break
        shell = query[left, None] + radius * size * directions
        values = field.values(shell.reshape(-1, 3)).reshape(len(left), -1)
        other = (values < 0) != inside[left, None]
        found = other.any(dim=1)
        rows = left[found]
        # The first of several, after the strongest: the zero is then likely to be nearest there.
        strength = torch.where(other, values.abs(), -1.0)[found]
        heading[rows] = directions[strength.argmax(dim=1)]
        near[rows], far[rows] = previous * size, radius * size
        left = left[~found]
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        same = (field.values(query + middle[:, None] * heading) < 0) == inside
        near, far = torch.where(same, middle, near), torch.where(same, far, middle)
    return query + far[:, None] * heading, far > 0
