"""A field that ends at the faces of its domain, where what is inside is closed with flat caps."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.surfaces.box import Box
from ndf_core.surfaces.implicit_field import ImplicitField

_MARGIN = 0.02
"""Of the bounds beyond the caps, as a share of the size."""


class CappedField(ImplicitField):
    """max(phi, slope * distance to the domain's planes): the solid of phi cut off at the planes."""

    def __init__(
        self,
        field: ImplicitField,
        normals: Float[Array, "k 3"],
        offsets: Float[Array, " k"],
        slope: float,
        bounds: Box,
    ) -> None:
        """Cut `field` where normal . x > offset.

        Args:
            field: phi.
            normals: unit vectors outwards.
            offsets: of the planes.
            slope: gradient of phi near its surface, so that both parts of the maximum are alike.
            bounds: a box that holds the domain with a margin.
        """
        self.field = field
        self.bounds = bounds
        self.block, self.rounding, self.has_plateaus = field.block, field.rounding, field.has_plateaus
        self.lipschitz = max(field.lipschitz, slope)
        self._normals, self._offsets, self._slope = normals, offsets, slope

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        return torch.maximum(self.field.evaluate(points), self._cap(points)[0])

    def evaluate_with_gradient(
        self, points: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        values, gradients = self.field.evaluate_with_gradient(points)
        cap, plane = self._cap(points)
        beyond = cap > values
        flat = self._slope * points.new_tensor(self._normals)[plane]
        return torch.where(beyond, cap, values), torch.where(beyond[:, None], flat, gradients)

    def clearance(self, points: Float[Tensor, "n 3"], values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        known = self.field.clearance(points, torch.zeros_like(values))
        to_planes = self._cap(points)[0].abs() / self._slope
        return torch.maximum(super().clearance(points, values), torch.minimum(known, to_planes))

    def _cap(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Int[Tensor, " n"]]:
        """Slope times distance beyond the nearest plane, and which that is."""
        beyond = points @ points.new_tensor(self._normals).T - points.new_tensor(self._offsets)
        largest = beyond.max(dim=1)
        return self._slope * largest.values, largest.indices


def capped_by_box(field: ImplicitField, box: Box, slope: float) -> CappedField:
    """`field` cut off at the faces of a box."""
    normals = np.concatenate([-np.eye(3), np.eye(3)])
    margin = _MARGIN * field.bounds.longest_side
    return CappedField(field, normals, np.concatenate([-box.lower, box.upper]), slope, field.bounds.grown(margin))
