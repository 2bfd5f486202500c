"""Steps towards the zero set of a field that is not a distance and has edges, row by row.

Each step is Newton's, -phi g / |g|^2, shortened until |phi| falls in proportion. Where that fails or is slow and the
gradient has turned, an edge lies between two points seen: then the step goes to the nearest point of both tangent
planes at once, which is on the edge if its faces are flat. Points without a gradient (the centre of a ball) are moved
a little first, and so are points where no step helps (on a medial axis the gradient may run along it).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ndf_core.surfaces.dot_products import dot, squared_length
from ndf_core.surfaces.implicit_field import ImplicitField

TOLERANCE = 1e-6
"""Rows count as landed when |phi| / |grad phi| is below this share of the size, which fields in single precision can
reach. They go on until it is below the field's own rounding, or stands still."""
_SMALLEST_DAMPING = 2.0**-5
_FLAT = 1e-7
"""Gradients below this share of the Lipschitz bound give no direction (centres, axes)."""
_LONG, _SHORT = 0.25, 1.0 / 32.0
"""Longest steps, as shares of the size: anywhere, and where the gradient is flat."""
_UNEVEN = 0.125
"""Gradients below this share of the Lipschitz bound are flat: occupancies have plateaus."""
_SMALLEST_SHARE = 0.1
"""Least that is left of a step that went too far."""
_MOST_KICKS = 3
_KICK = (3.6e-4, 4.8e-4, 8.0e-4)
"""Direction without symmetry, a thousandth of the size long: leaves a centre or an axis."""
_KINK = 0.9
"""Cosine between neighbouring gradients below which an edge is taken to lie between them."""


@dataclass
class Rows:
    """Points under way, with the field there."""

    points: Float[Tensor, "m 3"]
    values: Float[Tensor, " m"]
    gradients: Float[Tensor, "m 3"]
    damping: Float[Tensor, " m"]
    other: Float[Tensor, "m 3"]
    """Gradient at a neighbouring point: the other face of an edge, if there is one between."""
    other_offset: Float[Tensor, " m"]
    """That point's tangent plane is where other . x + other_offset vanishes."""
    at_kink: Bool[Tensor, " m"]
    kicks: Float[Tensor, " m"]
    """How often the row was stuck and has been moved off."""

    @staticmethod
    def at(field: ImplicitField, points: Float[Tensor, "m 3"]) -> Rows:
        """Rows that begin at `points`."""
        values, gradients = field.values_and_gradients(points)
        zero, no = torch.zeros_like(values), torch.zeros_like(values, dtype=torch.bool)
        return Rows(
            points.clone(), values, gradients, torch.ones_like(values), torch.zeros_like(points), zero, no, zero
        )

    def select(self, rows: Int[Tensor, " k"] | Bool[Tensor, " m"]) -> Rows:
        return Rows(**{name: value[rows] for name, value in vars(self).items()})

    @property
    def errors(self) -> Float[Tensor, " m"]:
        """First-order distance to the zero set, |phi| / |grad phi|; infinite where there is no gradient."""
        errors = self.values.abs() / squared_length(self.gradients).sqrt()
        return torch.where(errors.isfinite(), errors, torch.inf)

    def landed(self, size: float, rounding: float) -> Bool[Tensor, " m"]:
        """Rows that no step would bring nearer to the zero set."""
        return self.errors <= size * torch.where(self.damping <= _SMALLEST_DAMPING, TOLERANCE, rounding)

    def lost(self) -> Bool[Tensor, " m"]:
        """Rows that have been stuck too often, or have met values that are not finite."""
        return (self.kicks > _MOST_KICKS) | ~self.values.isfinite() | ~self.gradients.isfinite().all(dim=1)


def step(
    field: ImplicitField,
    rows: Rows,
    size: float,
    jump: Bool[Tensor, " m"],
    offset: Float[Tensor, "m 3"],
) -> Rows:
    """Move every row once: those in `jump` by `offset`, the others towards the zero set.

    Args:
        field: phi, evaluated once per row.
        rows: where they are.
        size: longest side of the surface; steps are at most a quarter of it.
        jump: rows that start anew elsewhere.
        offset: how far from where they are.
    """
    kicked = squared_length(rows.gradients) < (_FLAT * field.lipschitz) ** 2
    kicked |= rows.damping <= _SMALLEST_DAMPING
    kicked &= ~jump
    fresh = kicked | jump
    damping = torch.where(rows.at_kink, 1.0, rows.damping)
    move = torch.where(rows.at_kink[:, None], _to_both_planes(rows), _newton(rows))
    length = squared_length(move).sqrt()
    # Where the field is much flatter than it is elsewhere, Newton's step leads far beyond the surface.
    flat = squared_length(rows.gradients) < (_UNEVEN * field.lipschitz) ** 2
    longest = torch.where(flat, _SHORT * size, _LONG * size)
    move = move * (damping * (longest / length).clamp_max(1.0))[:, None]
    move = torch.where(kicked[:, None], move.new_tensor(_KICK) * size, move)
    trial = rows.points + torch.where(jump[:, None], offset, move)
    values, gradients = field.values_and_gradients(trial)
    share = values.abs() / rows.values.abs()
    accepted = (share <= 1.0 - 0.25 * damping) | fresh
    # Of the two tangent planes met, the one that is not at the new position is the other.
    other = torch.where(accepted[:, None], rows.gradients, gradients)
    plane = torch.where(accepted, rows.values, values)
    place = torch.where(accepted[:, None], rows.points, trial)
    hindered = (~accepted | (share > 0.5)) & (_cosine(rows.gradients, gradients) < _KINK)
    # A step that was too long across the surface has enclosed it: then regula falsi says how much of it to take.
    enclosed = (values < 0) != (rows.values < 0)
    shortening = torch.where(enclosed, (1.0 / (1.0 + share)).clamp(_SMALLEST_SHARE, 0.5), 0.5)
    shorter = torch.where(rows.at_kink, rows.damping, shortening * rows.damping)
    grown = torch.where(accepted, (2.0 * rows.damping).clamp_max(1.0), shorter)
    return Rows(
        points=torch.where(accepted[:, None], trial, rows.points),
        values=torch.where(accepted, values, rows.values),
        gradients=torch.where(accepted[:, None], gradients, rows.gradients),
        damping=torch.where(fresh, 1.0, grown),
        other=other,
        other_offset=plane - dot(other, place),
        at_kink=hindered & ~(rows.at_kink & ~accepted) & ~fresh,
        kicks=rows.kicks + kicked,
    )


def _newton(rows: Rows) -> Float[Tensor, "m 3"]:
    squared = squared_length(rows.gradients)
    return rows.gradients * (-rows.values / squared.clamp_min(1e-300))[:, None]


def _to_both_planes(rows: Rows) -> Float[Tensor, "m 3"]:
    """Shortest move into both tangent planes: combine the two gradients so that both linear parts vanish."""
    here, there = rows.gradients, rows.other
    residual_here = rows.values
    residual_there = dot(there, rows.points) + rows.other_offset
    a, b, c = (dot(u, v) for u, v in ((here, here), (here, there), (there, there)))
    determinant = (a * c - b * b).clamp_min(1e-300)
    weight_here = (b * residual_there - c * residual_here) / determinant
    weight_there = (b * residual_here - a * residual_there) / determinant
    return weight_here[:, None] * here + weight_there[:, None] * there


def _cosine(one: Float[Tensor, "m 3"], two: Float[Tensor, "m 3"]) -> Float[Tensor, " m"]:
    return dot(one, two) / (squared_length(one) * squared_length(two)).clamp_min(1e-300).sqrt()
