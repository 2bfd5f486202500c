"""What every node of a CSG tree offers, and the number types that its fields are made of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Annotated

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from pydantic import BaseModel, ConfigDict, Field
from torch import Tensor

from ndf_core.surfaces.box import Box

if TYPE_CHECKING:
    from ndf_plugin_sdf.csg.tree import Shape

LARGEST = 1e9
"""Largest coordinate, length or factor that a tree may name: squares and products of a few stay far from overflow."""

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Length = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1e-12, le=LARGEST)]
"""A length above zero."""
Vector = tuple[Number, Number, Number]
Lengths = tuple[Length, Length, Length]

ORIGIN: Vector = (0.0, 0.0, 0.0)


class Node(BaseModel, ABC):
    """A solid given by a field: negative inside, positive outside, zero on its surface.

    The field is a bound of the distance, not always the distance: its gradient's length is at most `lipschitz`.
    Points are columns, float64 and shape (3, n), so that every coordinate is one contiguous row: on a CPU the
    arithmetic on 8,192 points is two to three times as fast as with rows.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    @abstractmethod
    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        """The field at `points`; differentiable, with finite gradients everywhere."""

    @abstractmethod
    def bounds(self, level: float = 0.0) -> Box:
        """A box that holds every point where the field is at most `level`. It may reach to infinity."""

    @abstractmethod
    def lipschitz(self, domain: Box) -> float:
        """Bound of the gradient's length over `domain`, a box; 1 for a distance."""

    @property
    @abstractmethod
    def cost(self) -> int:
        """Work per point, in evaluations of a simple primitive; copies count."""


class Primitive(Node):
    """A node without children whose field is the exact signed distance."""

    @abstractmethod
    def extent(self) -> Box:
        """Bounding box of the solid."""

    def bounds(self, level: float = 0.0) -> Box:
        # A ball of radius -level about a point with distance level < 0 lies in the solid, hence in its box; for
        # level > 0 the nearest point of the solid is in its box. So growing (or shrinking) by level is right.
        return self.extent().grown(level)

    def lipschitz(self, domain: Box) -> float:
        return 1.0

    @property
    def cost(self) -> int:
        return 1


class Modifier(Node):
    """A node with one child."""

    child: Shape = Field(description="the solid that it changes")

    def lipschitz(self, domain: Box) -> float:
        return self.child.lipschitz(domain)

    @property
    def cost(self) -> int:
        return self.child.cost


def column(vector: Vector | Array, like: Tensor) -> Float[Tensor, "3 1"]:
    """`vector` as a column that adds to points."""
    return like.new_tensor(np.asarray(vector, dtype=np.float64)).reshape(-1, 1)
