"""Numbers on a regular grid in space, interpolated trilinearly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.surfaces.box import Box

_CORNERS = ((0, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 1), (1, 0, 0), (1, 0, 1), (1, 1, 0), (1, 1, 1))


@dataclass(frozen=True)
class Nodes:
    """Where the nodes of a grid lie: `counts` along x, y, z, the outermost on the faces of `box`; input units."""

    box: Box
    counts: tuple[int, int, int]

    @classmethod
    def over(cls, box: Box, resolution: int) -> Nodes:
        """`resolution` cells along the longest side, an even number along each, as cubic as that allows."""
        extent = box.upper - box.lower
        cells = 2 * np.maximum(1, np.ceil(resolution * extent / extent.max() / 2 - 1e-9)).astype(int)
        x, y, z = (int(count) + 1 for count in cells)
        return cls(box, (x, y, z))

    @property
    def step(self) -> Float[Array, "3"]:
        """Distance of neighbouring nodes along each axis."""
        return (self.box.upper - self.box.lower) / (np.array(self.counts) - 1)

    @property
    def total(self) -> int:
        return int(np.prod(self.counts))

    def positions(self, index: Int[Array, "... 3"] | Float[Array, "... 3"]) -> Float[Array, "... 3"]:
        """Points in input units; halves lie between nodes."""
        return self.box.lower + index * self.step

    def every_other(self) -> Nodes:
        """The nodes with even numbers."""
        x, y, z = (count // 2 + 1 for count in self.counts)
        return Nodes(self.box, (x, y, z))


class Trilinear:
    """A continuous function from its values at nodes; beyond the box it is constant."""

    def __init__(self, nodes: Nodes, values: Float[Array, "x y z"], beyond: float) -> None:
        """Take values at the nodes, and the value beyond the box."""
        self.nodes, self._beyond = nodes, beyond
        self._values = torch.from_numpy(np.ascontiguousarray(values, np.float32)).flatten()
        self._lower, self._upper = (torch.from_numpy(corner) for corner in (nodes.box.lower, nodes.box.upper))
        self._per_unit = torch.from_numpy(1.0 / nodes.step)
        self._last = torch.tensor([count - 1 for count in nodes.counts], dtype=torch.float64)
        self._strides = (nodes.counts[1] * nodes.counts[2], nodes.counts[2], 1)

    def __call__(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """Values at points (float64, input units, CPU)."""
        place = ((points - self._lower) * self._per_unit).clamp_min(0.0).minimum(self._last)
        cell = torch.minimum(place.floor(), self._last - 1)
        high = (place - cell).float()
        weights = torch.stack([1.0 - high, high], dim=2)
        x, y, z = cell.long().unbind(1)
        start = x * self._strides[0] + y * self._strides[1] + z
        total = torch.zeros(len(points))
        for i, j, k in _CORNERS:
            corner = self._values[start + (i * self._strides[0] + j * self._strides[1] + k)]
            total += corner * weights[:, 0, i] * weights[:, 1, j] * weights[:, 2, k]
        beyond = ((points < self._lower) | (points > self._upper)).any(dim=1)
        return total.masked_fill_(beyond, self._beyond)

    def gradients(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Central differences over one cell to either side: smoother than the gradient inside a single cell."""
        parts: list[Tensor] = []
        for axis, width in enumerate(self.nodes.step.tolist()):
            shift = torch.zeros(3, dtype=torch.float64)
            shift[axis] = width
            parts.append((self(points + shift) - self(points - shift)) / (2.0 * width))
        return torch.stack(parts, dim=1)
