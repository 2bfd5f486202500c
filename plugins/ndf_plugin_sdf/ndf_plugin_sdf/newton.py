"""Landing on the zero set of a field that is not a distance and has edges: safeguarded Newton steps, row by row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ndf_plugin_sdf.implicit_field import ImplicitField

GOAL = 1e-10
"""Rows go on until |phi| / |grad phi| is below this share of the size, or stands still."""
TOLERANCE = 1e-6
"""They count as landed below this: what a field computed in single precision can reach."""

_SMALLEST_DAMPING = 2.0**-8
_FLAT = 1e-7
"""Gradients below this share of the Lipschitz bound give no direction (centres, axes)."""
_MOST_KICKS = 3
_KINK = 0.9
"""Cosine between neighbouring gradients below which an edge is taken to lie between them."""


class Landing(NamedTuple):
    """Where rows ended, with the field there."""

    points: Float[Tensor, "n 3"]
    values: Float[Tensor, " n"]
    gradients: Float[Tensor, "n 3"]

    @property
    def errors(self) -> Float[Tensor, " n"]:
        """First-order distance to the zero set, |phi| / |grad phi|; infinite where there is no gradient."""
        slope = self.gradients.square().sum(dim=1).sqrt()
        errors = self.values.abs() / slope
        return torch.where(errors.isfinite(), errors, torch.inf)


@dataclass
class _State:
    """Rows still under way."""

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

    def select(self, rows: Int[Tensor, " k"] | Bool[Tensor, " m"]) -> _State:
        return _State(**{name: value[rows] for name, value in vars(self).items()})


def land(field: ImplicitField, start: Float[Tensor, "n 3"], size: float, most_steps: int) -> Landing:
    """Move every point to the zero set along the gradient.

    Each step is Newton's, -phi g / |g|^2, shortened until |phi| falls in proportion. Where that fails or is slow and
    the gradient has turned, an edge lies between two points seen: then the step goes to the nearest point of both
    tangent planes at once, which is on the edge if its faces are flat. Points without a gradient (the centre of a
    ball) are moved a little first, and so are points where no step helps (on a medial axis the gradient may run along
    it). A row stops when |phi| / |g| reaches `GOAL`, when no step helps below `TOLERANCE`, or when it has been moved
    like that too often.

    Args:
        field: phi.
        start: where to begin.
        size: longest side of the surface, which tolerances are shares of; steps are at most a quarter of it.
        most_steps: most evaluations per row.
    """
    values, gradients = field.values_and_gradients(start)
    result = Landing(start.clone(), values, gradients)
    rows = torch.arange(len(start), device=start.device)
    state = _State(
        *(start.clone(), values, gradients, torch.ones_like(values)),
        *(torch.zeros_like(start), torch.zeros_like(values), torch.zeros_like(values, dtype=torch.bool)),
        torch.zeros_like(values),
    )
    for _ in range(most_steps):
        slope = state.gradients.square().sum(dim=1).sqrt()
        stuck = state.damping <= _SMALLEST_DAMPING
        going = state.values.abs() > size * slope * torch.where(stuck, TOLERANCE, GOAL)
        going &= state.kicks <= _MOST_KICKS
        going &= state.values.isfinite() & slope.isfinite()
        if not bool(going.all()):
            rows, state = rows[going], state.select(going)
        if not len(rows):
            break
        state = _step(field, state, size)
        for kept, current in zip(result, (state.points, state.values, state.gradients), strict=True):
            kept[rows] = current
    return result


def _step(field: ImplicitField, state: _State, size: float) -> _State:
    flat = state.gradients.square().sum(dim=1) < (_FLAT * field.lipschitz) ** 2
    flat |= state.damping <= _SMALLEST_DAMPING
    move = torch.where(state.at_kink[:, None], _to_both_planes(state), _newton(state))
    length = move.square().sum(dim=1, keepdim=True).sqrt()
    damping = torch.where(state.at_kink, 1.0, state.damping)
    move = damping[:, None] * move * (0.25 * size / length).clamp_max(1.0)
    if bool(flat.any()):
        move = torch.where(flat[:, None], move.new_tensor(_KICK) * size, move)
    trial = state.points + move
    values, gradients = field.values_and_gradients(trial)
    share = values.abs() / state.values.abs()
    accepted = (share <= 1.0 - 0.25 * damping) | flat
    # Of the two tangent planes met, the one that is not at the new position is the other.
    other = torch.where(accepted[:, None], state.gradients, gradients)
    offset = torch.where(accepted, state.values, values)
    place = torch.where(accepted[:, None], state.points, trial)
    turned = _cosine(state.gradients, gradients) < _KINK
    hindered = ~accepted | (share > 0.5)
    at_kink = turned & hindered & ~(state.at_kink & ~accepted)
    shorter = torch.where(state.at_kink, state.damping, 0.5 * state.damping)
    return _State(
        points=torch.where(accepted[:, None], trial, state.points),
        values=torch.where(accepted, values, state.values),
        gradients=torch.where(accepted[:, None], gradients, state.gradients),
        damping=torch.where(flat, 1.0, torch.where(accepted, (2.0 * state.damping).clamp_max(1.0), shorter)),
        other=other,
        other_offset=offset - (other * place).sum(dim=1),
        at_kink=at_kink & ~flat,
        kicks=state.kicks + flat,
    )


_KICK = (3.6e-4, 4.8e-4, 8.0e-4)
"""Direction without symmetry, a thousandth of the size long: leaves a centre or an axis."""


def _newton(state: _State) -> Float[Tensor, "m 3"]:
    squared = state.gradients.square().sum(dim=1)
    return state.gradients * (-state.values / squared.clamp_min(1e-300))[:, None]


def _to_both_planes(state: _State) -> Float[Tensor, "m 3"]:
    """Shortest move into both tangent planes: combine the two gradients so that both linear parts vanish."""
    here, there = state.gradients, state.other
    residual_here = state.values
    residual_there = (there * state.points).sum(dim=1) + state.other_offset
    a, b, c = ((u * v).sum(dim=1) for u, v in ((here, here), (here, there), (there, there)))
    determinant = (a * c - b * b).clamp_min(1e-300)
    weight_here = (b * residual_there - c * residual_here) / determinant
    weight_there = (b * residual_here - a * residual_there) / determinant
    return weight_here[:, None] * here + weight_there[:, None] * there


def _cosine(one: Float[Tensor, "m 3"], two: Float[Tensor, "m 3"]) -> Float[Tensor, " m"]:
    return (one * two).sum(dim=1) / (one.square().sum(dim=1) * two.square().sum(dim=1)).clamp_min(1e-300).sqrt()
