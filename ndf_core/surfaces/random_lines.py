"""Points spread evenly by area over a level set, as the crossings of random lines.

Lines drawn uniformly (every direction and position alike) meet every piece of surface in proportion to its area,
whatever its shape. So no mesh stands between the surface and its samples, and thin parts get their share.

Reference: Crofton's formula; L. A. Santalo, Integral Geometry and Geometric Probability, 1976, ch. 14.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.surfaces.implicit_field import ImplicitField

_FEWEST_LINES, _MOST_LINES = 1024, 262_144
"""Lines that are followed together: in few batches, since each ends with many small steps of lines that graze."""
_SPARE = 1.05
_SHORTEST_STEP, _PLATEAU_STEP = 1.0 / 1024.0, 1.0 / 256.0
"""Shares of the size: two crossings of a line that are nearer to each other may both be missed. The second is for
fields with plateaus, whose Lipschitz bound allows no other step."""
_MOST_BATCHES = 2000
_HALVINGS = 60


class _Segments(NamedTuple):
    """Parts of lines: from `origin + start * direction` to `origin + end * direction`."""

    origin: Float[Tensor, "m 3"]
    direction: Float[Tensor, "m 3"]
    start: Float[Tensor, " m"]
    end: Float[Tensor, " m"]

    def at(self, position: Float[Tensor, " m"]) -> Float[Tensor, "m 3"]:
        return self.origin + position[:, None] * self.direction

    def select(self, rows: Tensor) -> _Segments:
        return _Segments(*(part[rows] for part in self))


def sample_level_set(
    field: ImplicitField, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """`count` points on the zero set of `field`, even by area, and the unit normals there; input units.

    Raises:
        InputError: lines through the bounds hardly ever meet the surface.
    """
    found: list[Tensor] = []
    total = followed = 0
    for batch in range(_MOST_BATCHES):
        if total >= count:
            break
        if batch == 100 and not total:
            raise InputError("no surface found: none of many lines through its bounds met a zero of the field")
        # About one line in three meets a surface that fills its bounds, most of them twice.
        share = total / followed if total else 0.5
        lines = min(_MOST_LINES, max(_FEWEST_LINES, round(_SPARE * (count - total) / share)))
        followed += lines
        points = _bisected(field, _crossings(field, _lines_through(field, lines, rng)))
        found.append(points)
        total += len(points)
    points = torch.cat(found) if found else torch.zeros(0, 3, dtype=torch.float64)
    if total < count:
        raise InputError(f"only {total} of {count} samples found: the surface is tiny in its bounds; tighten them")
    points = points[torch.from_numpy(rng.permutation(total)[:count])]
    _, gradients = field.values_and_gradients(points)
    normals = torch.nan_to_num(gradients / gradients.square().sum(dim=1, keepdim=True).sqrt())
    return points.numpy(), normals.numpy()


def _lines_through(field: ImplicitField, count: int, rng: np.random.Generator) -> _Segments:
    """`count` uniform random lines through the ball about the bounds, cut to the bounds."""
    lower, upper = field.bounds.lower, field.bounds.upper
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # A point uniform in the ball's disc across the direction: a direction across, and the root of a uniform radius.
    across = np.cross(direction, rng.standard_normal((count, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    radius = np.linalg.norm(upper - lower) / 2 * np.sqrt(rng.random((count, 1)))
    origin = (lower + upper) / 2 + radius * across
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(lower - origin) / direction, (upper - origin) / direction])
    start, end = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    hit = start < end
    return _Segments(*(torch.from_numpy(part[hit]) for part in (origin, direction, start, end)))


def _crossings(field: ImplicitField, lines: _Segments) -> _Segments:
    """Segments whose ends have different signs: walk along each line by what is free, at least a little."""
    shortest = field.bounds.longest_side * (_PLATEAU_STEP if field.has_plateaus else _SHORTEST_STEP)
    position = lines.start
    place = lines.at(position)
    value = field.values(place)
    found: list[_Segments] = []
    while len(position):
        following = torch.minimum(position + field.clearance(place, value).clamp_min(shortest), lines.end)
        place = lines.at(following)
        ahead = field.values(place)
        crossed = (value < 0) != (ahead < 0)
        if bool(crossed.any()):
            rows = lines.select(crossed)
            found.append(_Segments(rows.origin, rows.direction, position[crossed], following[crossed]))
        going = following < lines.end
        lines, position, place, value = lines.select(going), following[going], place[going], ahead[going]
    if not found:
        return lines.select(torch.zeros(0, dtype=torch.long))
    return _Segments(*(torch.cat(parts) for parts in zip(*found, strict=True)))


def _bisected(field: ImplicitField, segments: _Segments) -> Float[Tensor, "m 3"]:
    """The zero on each segment, by regula falsi with Illinois' weights and a bisection every third turn."""
    low, high = segments.start, segments.end
    below, above = field.values(segments.at(low)), field.values(segments.at(high))
    best, going = 0.5 * (low + high), torch.arange(len(low))
    for turn in range(_HALVINGS):
        if not len(going):
            break
        secant = low + (high - low) * (below / (below - above)).clamp(0.0, 1.0)
        middle = secant if turn % 3 < 2 else 0.5 * (low + high)
        best[going] = middle
        value = field.values(segments.select(going).at(middle))
        # How far the zero can be: the value over the slope of the chord, which halved ends make flatter only.
        error = value.abs() * (high - low) / (below - above).abs()
        same = (value < 0) == (below < 0)
        # Halving the value at the end that stays keeps the secant from creeping.
        above, below = torch.where(same, 0.5 * above, value), torch.where(same, value, 0.5 * below)
        low, high = torch.where(same, middle, low), torch.where(same, high, middle)
        left = torch.minimum(error, high - low) > field.rounding * field.bounds.longest_side
        going, low, high, below, above = (part[left] for part in (going, low, high, below, above))
    return segments.at(best)
