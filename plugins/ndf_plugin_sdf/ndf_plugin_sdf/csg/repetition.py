"""Finitely many copies of a solid for the price of the few nearest ones.

Which copies can be nearest follows from the child's box. Copies differ by a shift along the axes (or a turn about z),
and of all copies of one child point c the nearest to x is the one whose number is (x - c) / spacing, rounded: as c
runs through the box, that names a short interval of numbers. Evaluating those makes the sign exact, makes the field
of a child with an exact distance the exact distance outside, and keeps |field(x)| <= L * (distance of x to the
surface) for any child with Lipschitz bound L: for each point of the surface, a candidate has its copy of it at least
as near.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from pydantic import Field, model_validator
from torch import Tensor

from ndf_core.surfaces.box import Box, hull
from ndf_plugin_sdf.csg.node import Lengths, Modifier, column
from ndf_plugin_sdf.csg.shaping import swept

MOST_CANDIDATES = 128
"""Most copies evaluated per point: more means that the copies overlap over and over."""

Count = Annotated[int, Field(strict=True, ge=1, le=100_000)]


class _Copies(Modifier):
    @cached_property
    def solid(self) -> Box:
        """The child's box, which has to be finite.

        Raises:
            ValueError: it is not, or it is empty.
        """
        box = self.child.bounds()
        if box.empty or not box.finite:
            raise ValueError("the child must be bounded; intersect planes with a box first")
        return box

    def nearest(self, copies: Float[Tensor, "k 3 n"]) -> Float[Tensor, " n"]:
        """Smallest of the child's field over the points as seen by k copies."""
        seen = copies.permute(1, 0, 2).reshape(3, -1)
        return self.child.distance(seen).reshape(len(copies), -1).amin(dim=0)


class Repeat(_Copies):
    """Copies of the child on a grid: copy (i, j, k) is moved by (i, j, k) times the spacing, from 0 to count - 1."""

    type: Literal["repeat"]
    count: tuple[Count, Count, Count] = Field(description="number of copies along x, y and z")
    spacing: Lengths = Field(description="distance between neighbouring copies along x, y and z")

    @model_validator(mode="after")
    def _is_bounded(self) -> Repeat:
        if math.prod(self._candidates) > MOST_CANDIDATES:
            raise ValueError(f"each point is near more than {MOST_CANDIDATES} copies; take a wider spacing")
        return self

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        last = column(np.array(self.count) - 1, points)
        spacing = column(self.spacing, points)
        upper = column(self.solid.upper, points)
        with torch.no_grad():
            first = ((points - upper) / spacing + 0.5).floor()
            steps = np.stack(np.meshgrid(*map(range, self._candidates), indexing="ij"), axis=-1).reshape(-1, 3)
            # Where every copy is a candidate, the numbers are simply all of them.
            every = column(np.array(self._candidates) >= np.array(self.count), points) > 0
            first = torch.where(every, 0.0, first)
            number = (first + points.new_tensor(steps)[:, :, None]).clamp_min(0.0).minimum(last)
        return self.nearest(points - number * spacing)

    def bounds(self, level: float = 0.0) -> Box:
        box = self.child.bounds(level)
        return hull([box, box.moved(self._last_offset())])

    def lipschitz(self, domain: Box) -> float:
        # Where a copy sees the domain: candidates have their box at most 1.5 spacings away, but for the last ones.
        box, spacing, end = self.solid, np.array(self.spacing), self._last_offset()
        every = np.array(self._candidates) >= np.array(self.count)
        lower = np.where(every, domain.lower - end, np.minimum(domain.lower, box.lower - 1.5 * spacing))
        upper = np.where(every, domain.upper, np.maximum(domain.upper - end, box.upper + 0.5 * spacing))
        return self.child.lipschitz(Box(lower, upper))

    @property
    def cost(self) -> int:
        return math.prod(self._candidates) * self.child.cost

    def _last_offset(self) -> Float[Array, "3"]:
        return (np.array(self.count) - 1) * np.array(self.spacing)

    @cached_property
    def _candidates(self) -> tuple[int, ...]:
        """How many copies per axis can be nearest to one point."""
        box = self.solid
        share = (box.upper - box.lower) / np.array(self.spacing)
        return tuple(int(min(count, math.ceil(part) + 1)) for count, part in zip(self.count, share, strict=True))


class RepeatAround(_Copies):
    """Copies of the child turned about the z axis, evenly over the full circle; the first is the child itself."""

    type: Literal["repeat_around"]
    count: Count = Field(description="number of copies")

    @model_validator(mode="after")
    def _is_bounded(self) -> RepeatAround:
        if self._candidates[1] > MOST_CANDIDATES:
            raise ValueError(f"each point is near more than {MOST_CANDIDATES} copies; move the child off the z axis")
        return self

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        x, y, z = points.unbind()
        with torch.no_grad():
            cosine, sine = self._turns(x, y)
        return self.nearest(torch.stack([cosine * x + sine * y, cosine * y - sine * x, z.expand_as(sine)], dim=1))

    def bounds(self, level: float = 0.0) -> Box:
        return swept(self.child.bounds(level))

    def lipschitz(self, domain: Box) -> float:
        return self.child.lipschitz(swept(domain))

    @property
    def cost(self) -> int:
        return self._candidates[1] * self.child.cost

    def _turns(
        self, x: Float[Tensor, " n"], y: Float[Tensor, " n"]
    ) -> tuple[Float[Tensor, "k n"], Float[Tensor, "k n"]]:
        """Cosine and sine of the angles of the copies that can be nearest to each point."""
        step = 2.0 * np.pi / self.count
        leading, many = self._candidates
        angles = step * np.arange(self.count)
        first = ((torch.atan2(y, x) - leading) / step + 0.5).floor()
        number = (first + torch.arange(many, device=x.device)[:, None]).remainder(self.count).long()
        return x.new_tensor(np.cos(angles))[number], x.new_tensor(np.sin(angles))[number]

    @cached_property
    def _candidates(self) -> tuple[float, int]:
        """Largest angle of the child's box about z, and how many copies can be nearest to one point."""
        box = self.solid
        if (box.lower[:2] <= 0).all() and (box.upper[:2] >= 0).all():
            return 0.0, self.count
        # The box does not reach the axis, so it spans less than half a turn, from corner to corner.
        middle = math.atan2(*((box.lower + box.upper)[1::-1]))
        corner = np.arctan2(box.corners[:, 1], box.corners[:, 0])
        half = float(np.abs((corner - middle + np.pi) % (2.0 * np.pi) - np.pi).max())
        return middle + half, min(self.count, math.ceil(2.0 * half * self.count / (2.0 * np.pi)) + 1)
