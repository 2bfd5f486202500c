"""Landing on the zero set, and walking along it towards the closest point."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ndf_core.surfaces.dot_products import dot, squared_length
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_core.surfaces.newton import Rows, step

WORTH_CORRECTING = 1e-5
"""Tangential offsets below this share of the size are left alone: a tenth of the error of a good fit."""


class FootPoints(NamedTuple):
    """Where rows ended, with the field there."""

    points: Float[Tensor, "n 3"]
    gradients: Float[Tensor, "n 3"]
    errors: Float[Tensor, " n"]
    """First-order distance to the zero set; large where a row did not arrive."""


def foot_points(
    field: ImplicitField,
    query: Float[Tensor, "n 3"],
    size: float,
    corrections: int,
    most_steps: int,
    start: Float[Tensor, "n 3"] | None = None,
) -> FootPoints:
    """Points of the zero set near each query, as near as a few corrections make them.

    A row lands by Newton's steps. Where the field is a distance it is at the closest point; elsewhere it is off by an
    offset that is tangential to first order. So the query is projected onto the tangent plane where the row landed,
    and the row lands again from there; this contracts by about distance times curvature. The nearest landing counts.
    All rows take their steps together, whatever each is busy with, since many small evaluations cost more than one.

    Args:
        field: phi.
        query: float64.
        size: longest side of the surface, which tolerances are shares of.
        corrections: most landings after the first.
        most_steps: most evaluations per row.
        start: where the rows set out, if not at the query.

    Reference: E. Hartmann, On the curvature of curves and surfaces defined by normalforms, 1999.
    """
    rows, index = Rows.at(field, query if start is None else start), torch.arange(len(query), device=query.device)
    best = FootPoints(query.clone(), rows.gradients.clone(), torch.full_like(rows.values, torch.inf))
    walk = _Walk(query, best, size, corrections)
    for _ in range(most_steps):
        landed = rows.landed(size, field.rounding)
        jump, offset = walk.next(rows, index, landed)
        going = ~(landed & ~jump) & ~rows.lost()
        if not bool(going.all()):
            rows, index, jump, offset = rows.select(going), index[going], jump[going], offset[going]
        if not len(index):
            return best
        rows = step(field, rows, size, jump, offset)
    walk.next(rows, index, ~walk.arrived(index))
    return best


class _Walk:
    """The nearest landing of each row so far, and where to try next."""

    def __init__(self, query: Float[Tensor, "n 3"], best: FootPoints, size: float, corrections: int) -> None:
        self._query, self._best, self._size, self._corrections = query, best, size, corrections
        self._distance = torch.full_like(best.errors, torch.inf)
        self._damping = torch.ones_like(best.errors)
        self._landings = torch.zeros_like(best.errors)

    def arrived(self, index: Int[Tensor, " m"]) -> Bool[Tensor, " m"]:
        """Rows that have landed at least once."""
        return self._landings[index] > 0

    def next(
        self, rows: Rows, index: Int[Tensor, " m"], landed: Bool[Tensor, " m"]
    ) -> tuple[Bool[Tensor, " m"], Float[Tensor, "m 3"]]:
        """Record rows that landed; which of them are to start anew, and how far from where they are."""
        mine = index[landed]
        query, points, gradients = self._query[mine], rows.points[landed], rows.gradients[landed]
        distance = squared_length(query - points).sqrt()
        nearer = distance < self._distance[mine]
        kept = mine[nearer]
        for whole, part in zip(self._best, (points, gradients, rows.errors[landed]), strict=True):
            whole[kept] = part[nearer]
        self._distance[kept] = distance[nearer]
        self._damping[mine[~nearer]] *= 0.5
        self._landings[mine] += 1
        normal, place = self._best.gradients[mine], self._best.points[mine]
        along = (dot(query - place, normal) / squared_length(normal))[:, None]
        offset = (query - place - along * normal) * self._damping[mine, None]
        worth = squared_length(offset).sqrt() > WORTH_CORRECTING * self._size
        # Twice in vain: at an edge, where the offset stays.
        worth &= (self._damping[mine] > 0.3) & (self._landings[mine] <= self._corrections)
        jump = landed.clone()
        jump[landed] = worth
        moves = torch.zeros_like(rows.points)
        moves[landed] = place + offset - points
        return jump, moves
