"""A density in space, whatever it is computed by."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.surfaces.box import Box

BLOCK = 1 << 16
"""Most points per evaluation."""


class Density(ABC):
    """How opaque space is per unit of length; input units. Rows are independent."""

    bounds: Box
    """Where it means something; finite."""

    @abstractmethod
    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """Density of one block, float32. May be negative, which means the same as zero."""

    def values(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """Density at any number of points (float64), finite: what is no number counts as empty."""
        with torch.no_grad():
            blocks = [self.evaluate(part) for part in points.split(BLOCK)]
        values = torch.cat(blocks) if blocks else points.new_empty(0, dtype=torch.float32)
        return torch.nan_to_num(values, nan=0.0)

    def on_arrays(self, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """The same for numpy arrays."""
        return self.values(torch.from_numpy(np.ascontiguousarray(points, np.float64))).numpy()
