"""A density given as samples on a grid."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Integer
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.surfaces.box import Box
from ndf_plugin_nerf.density import Density
from ndf_plugin_nerf.lattice import Nodes, Trilinear

_LARGEST = 1e30
"""Of a density: sums of eight weighted ones must stay finite in single precision."""


class GridDensity(Density):
    """Trilinear between samples, which lie at the nodes of a grid from face to face of the bounds; empty outside."""

    def __init__(
        self, values: Float[Array, "x y z"] | Integer[Array, "x y z"] | Bool[Array, "x y z"], bounds: Box
    ) -> None:
        """Take samples with axes x, y, z; those that are not finite count as empty."""
        self.bounds = bounds
        finite = np.isfinite(values)
        self.replaced = int(values.size - finite.sum())
        x, y, z = values.shape
        samples = np.where(finite, values, 0).clip(-_LARGEST, _LARGEST).astype(np.float32)
        self._function = Trilinear(Nodes(bounds, (x, y, z)), samples, beyond=0.0)

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        return self._function(points)
