"""A field on a coarse lattice over its bounds: where it is negative, and the smaller box around that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.implicit_field import ImplicitField

_CELLS = 64
"""Along the longest side of the box."""
_MARGIN = 2
"""Cells around the negative values that may hold surface as well."""


@dataclass(frozen=True)
class Coarse:
    """phi at the corners of a lattice that spans the bounds."""

    bounds: Box
    values: Float[Array, "x y z"]

    @staticmethod
    def of(field: ImplicitField) -> Coarse:
        """Evaluate the field.

        Raises:
            InputError: a value is not finite.
        """
        lower, extent = field.bounds.lower, field.bounds.upper - field.bounds.lower
        counts = np.maximum(3, np.rint(_CELLS * extent / extent.max()).astype(int) + 1)
        shares = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in counts], indexing="ij"), axis=-1)
        points = lower + shares.reshape(-1, 3) * extent
        values = field.values(torch.from_numpy(points)).numpy()
        if not np.isfinite(values).all():
            place = ", ".join(f"{x:.6g}" for x in points[~np.isfinite(values)][0])
            raise InputError(f"the field is not finite at ({place})")
        return Coarse(field.bounds, values.reshape(counts))

    @property
    def negative_border(self) -> float:
        """Share of the bounds' faces where phi is negative."""
        border = np.ones(self.values.shape, dtype=bool)
        border[1:-1, 1:-1, 1:-1] = False
        return float((self.values[border] < 0).mean())

    def box_of_inside(self) -> Box:
        """The box of the negative values with a margin, within the bounds; there is a negative value."""
        low, high = np.empty(3), np.empty(3)
        inside = self.values < 0
        for axis in range(3):
            across = tuple(other for other in range(3) if other != axis)
            hit = np.flatnonzero(inside.any(axis=across))
            low[axis], high[axis] = hit[0] - _MARGIN, hit[-1] + _MARGIN
        last = np.array(self.values.shape) - 1
        extent = self.bounds.upper - self.bounds.lower
        shares = np.clip(np.stack([low, high]) / last, 0.0, 1.0)
        return Box(self.bounds.lower + shares[0] * extent, self.bounds.lower + shares[1] * extent)
