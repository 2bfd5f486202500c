"""A regular grid of numbers in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy import fft, ndimage

MARGIN = 6
"""Cells around what is to be seen."""


@dataclass(frozen=True)
class Grid:
    """Nodes at ``low + step * index``."""

    low: Float[Array, "3"]
    step: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(points: Float[Array, "n 3"], resolution: int) -> Grid:
        """`resolution` cells along the longest side of the points' box, and a margin."""
        low, high = points.min(axis=0), points.max(axis=0)
        step = float((high - low).max()) / resolution
        x, y, z = (int(n) + 1 + 2 * MARGIN for n in np.ceil((high - low) / step))
        return Grid(low - MARGIN * step, step, (x, y, z))

    def refined(self, factor: float) -> Grid:
        """The same space, or a little more, in cells so many times smaller: as many as sine transforms like."""
        x, y, z = (_fast(int(np.ceil((n - 1) * factor)) + 1) for n in self.shape)
        return Grid(self.low, self.step / factor, (x, y, z))

    @property
    def bounds(self) -> Float[Array, "2 3"]:
        """First and last node."""
        return np.stack([self.low, self.low + self.step * (np.array(self.shape) - 1)])

    def nodes(self, index: Int[Array, "n 3"]) -> Float[Array, "n 3"]:
        return self.low + self.step * index

    def deposit(self, points: Float[Array, "n 3"], amounts: Float[Array, " n"]) -> Float[Array, "x y z"]:
        """Amounts shared out to the eight nodes around each point, by trilinear weights; beyond the grid they count
        for nothing."""
        place = (points - self.low) / self.step
        inside = ((place >= 0) & (place < np.array(self.shape) - 1)).all(axis=1)
        place, amounts = place[inside], amounts[inside]
        first = np.floor(place).astype(np.int64)
        share = place - first
        total = np.zeros(int(np.prod(self.shape)))
        for corner in np.ndindex(2, 2, 2):
            weight = np.where(corner, share, 1.0 - share).prod(axis=1)
            index = np.ravel_multi_index(tuple((first + corner).T), self.shape)
            total += np.bincount(index, weight * amounts, minlength=len(total))
        return total.reshape(self.shape)

    def values(self, field: Float[Array, "x y z"], points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """Trilinear interpolation; beyond the grid the value at its border."""
        place = ((points - self.low) / self.step).T
        return ndimage.map_coordinates(field, place, order=1, mode="nearest", output=np.float64)

    def nearest(self, field: Bool[Array, "x y z"], points: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """Value at the node next to each point."""
        index = np.rint((points - self.low) / self.step).astype(np.int64)
        return field[tuple(np.clip(index, 0, np.array(self.shape) - 1).T)]


def _fast(count: int) -> int:
    """At least so many nodes, such that one more is a product of small primes."""
    return int(fft.next_fast_len(count + 1)) - 1  # pyright: ignore[reportArgumentType]  # a number, not None
