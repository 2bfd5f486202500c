"""Fields of several solids where the smallest matter, without evaluating those that cannot be among them.

A solid's box at level c (`Node.bounds`) holds all points where its field is at most c. So at a point outside of that
box where another field is at most c - reach, this one is more than `reach` above the minimum, and need not be known.
Near a surface with many ornaments that spares much of the work; the result is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ndf_core.surfaces.box import Box, hull
from ndf_plugin_sdf.csg.node import Node, column

_MARGIN = 0.02
"""Level of the boxes, as a share of the size of them all: wide enough for points near the surface."""
_MOST = 0.7
"""Share of the points above which a solid is evaluated at all of them."""
_FEW = 256
"""Points below which looking costs more than evaluating."""


@dataclass(frozen=True)
class Culled:
    """A solid and the box outside of which its field is above `level`; None where it is always evaluated."""

    solid: Node
    box: Box | None
    level: float


def culled(solids: Sequence[Node], reach: float) -> tuple[Culled, ...]:
    """Boxes for the solids that cost enough to look at them first."""
    size = hull(box for solid in solids if (box := solid.bounds()).finite).longest_side
    level = reach + _MARGIN * max(size, 0.0)
    boxes = [solid.bounds(level) if solid.cost > 1 else None for solid in solids]
    return tuple(
        Culled(solid, box if box is not None and box.finite else None, level)
        for solid, box in zip(solids, boxes, strict=True)
    )


def fields_near_minimum(
    lowest: Float[Tensor, " n"], others: Sequence[Culled], points: Float[Tensor, "3 n"], reach: float
) -> Float[Tensor, "m n"]:
    """`lowest` and the other fields; what is more than `reach` above the minimum may be given larger or smaller.

    Args:
        lowest: field of the first solid.
        others: the rest.
        points: where.
        reach: how far above the minimum a field still counts; 0 if only the minimum does.
    """
    few = len(lowest) < _FEW
    fields = [lowest]
    smallest = lowest.detach()
    for other in others:
        rows = None if few or other.box is None else _near(points, other, smallest, reach)
        if rows is None:
            field = other.solid.distance(points)
        else:
            # Above the minimum by `reach` and more, whatever the remaining solids bring.
            field = (smallest + (2.0 * reach + other.level)).index_copy(
                0, rows, other.solid.distance(points[:, rows])
            )
        fields.append(field)
        smallest = torch.minimum(smallest, field.detach())
    return torch.stack(fields)


def _near(
    points: Float[Tensor, "3 n"], other: Culled, smallest: Float[Tensor, " n"], reach: float
) -> Int[Tensor, " k"] | None:
    """Points where the solid may matter; None where that is most of them."""
    assert other.box is not None
    with torch.no_grad():
        lower, upper = column(other.box.lower, points), column(other.box.upper, points)
        inside = ((points >= lower) & (points <= upper)).all(dim=0)
        rows = (inside | (smallest + reach > other.level)).nonzero()[:, 0]
    return rows if len(rows) < _MOST * points.shape[1] else None
