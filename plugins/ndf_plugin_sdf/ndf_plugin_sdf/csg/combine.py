"""Union, intersection and difference, sharp and smooth."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import torch
from jaxtyping import Float
from pydantic import Field
from torch import Tensor

from ndf_core.surfaces.box import Box, hull, overlap
from ndf_plugin_sdf.csg.nearest import Culled, culled, fields_near_minimum
from ndf_plugin_sdf.csg.node import Length, Node
from ndf_plugin_sdf.csg.smooth import smooth_minimum

if TYPE_CHECKING:
    from ndf_plugin_sdf.csg.tree import Shape

MOST_CHILDREN = 256

Several = Annotated[tuple["Shape", ...], Field(min_length=2, max_length=MOST_CHILDREN)]


class _Combination(Node):
    """Minimum or maximum of the children's fields: never steeper than the steepest child."""

    children: Several = Field(description="the solids to combine, two or more")

    def lipschitz(self, domain: Box) -> float:
        return max(child.lipschitz(domain) for child in self.children)

    @property
    def cost(self) -> int:
        return sum(child.cost for child in self.children)

    @property
    def reach(self) -> float:
        """How far above the smallest field another still counts."""
        return 0.0

    @cached_property
    def others(self) -> tuple[Culled, ...]:
        """All children but the first."""
        return culled(self.children, self.reach)[1:]

    def low_fields(self, first: Float[Tensor, " n"], points: Float[Tensor, "3 n"]) -> Float[Tensor, "m n"]:
        """`first` and the fields of the other children; exact where they are within reach of the smallest."""
        return fields_near_minimum(first, self.others, points, self.reach)


class Union(_Combination):
    """Everything that is in at least one child."""

    type: Literal["union"]

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return self.low_fields(self.children[0].distance(points), points).amin(dim=0)

    def bounds(self, level: float = 0.0) -> Box:
        return hull(child.bounds(level) for child in self.children)


class Intersection(_Combination):
    """Everything that is in all children."""

    type: Literal["intersection"]

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return torch.stack([child.distance(points) for child in self.children]).amax(dim=0)

    def bounds(self, level: float = 0.0) -> Box:
        return overlap(child.bounds(level) for child in self.children)


class Difference(_Combination):
    """The first child without the others."""

    type: Literal["difference"]

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        # max(a, -b, ...) = -min(-a, b, ...)
        return -self.low_fields(-self.children[0].distance(points), points).amin(dim=0)

    def bounds(self, level: float = 0.0) -> Box:
        return self.children[0].bounds(level)


class _Blend(_Combination):
    """A combination whose creases are fillets: circular arcs of `radius` where two faces meet at a right angle."""

    radius: Length = Field(description="radius of the fillets")

    @property
    def reach(self) -> float:
        return self.radius

    def thickening(self) -> float:
        """How far below the minimum of equal fields the blended one lies."""
        return self.radius * (1.0 - len(self.children) ** -0.5)


class SmoothUnion(_Blend):
    """Union with its concave creases filled."""

    type: Literal["smooth_union"]

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return smooth_minimum(self.low_fields(self.children[0].distance(points), points), self.radius)

    def bounds(self, level: float = 0.0) -> Box:
        return hull(child.bounds(level + self.thickening()) for child in self.children)


class SmoothIntersection(_Blend):
    """Intersection with its convex edges rounded off."""

    type: Literal["smooth_intersection"]

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return -smooth_minimum(-torch.stack([child.distance(points) for child in self.children]), self.radius)

    def bounds(self, level: float = 0.0) -> Box:
        return overlap(child.bounds(level) for child in self.children)


class SmoothDifference(_Blend):
    """The first child without the others, with the cut's edges rounded off."""

    type: Literal["smooth_difference"]

    def distance(self, points: Float[Tensor, "3 n"]) -> Float[Tensor, " n"]:
        return -smooth_minimum(self.low_fields(-self.children[0].distance(points), points), self.radius)

    def bounds(self, level: float = 0.0) -> Box:
        return self.children[0].bounds(level)
