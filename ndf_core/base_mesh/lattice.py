"""The regular grid on which a scalar field is sampled, and the integer keys of its corners and cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.errors import BaseMeshError

CHUNK = 1 << 18
"""Most points that a field is asked for at once."""
CORNERS = np.array([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in range(8)])
"""Offsets of the corners of a cell."""


@dataclass(frozen=True)
class Lattice:
    """Corners at ``low + step * (index - 1)``; index 0 and the last ones lie beyond the bounds.

    The cells fit the bounds exactly, so they are cubes only nearly.
    """

    low: Float[Array, " 3"]
    step: Float[Array, " 3"]
    inner: Int[Array, " 3"]
    """Cells between the bounds, along each axis."""
    size: Int[Array, " 3"]
    """All cells along each axis: a multiple of `coarsest`."""
    coarsest: int

    @classmethod
    def over(cls, bounds: Float[Array, "2 3"], resolution: int, coarsest: int) -> Lattice:
        """`resolution` cells along the longest side of `bounds`, and a layer around them."""
        extent = bounds[1] - bounds[0]
        inner = np.maximum(1, np.rint(resolution * extent / extent.max())).astype(np.int64)
        size = -(-(inner + 2) // coarsest) * coarsest
        return cls(bounds[0], extent / inner, inner, size, coarsest)

    @property
    def diagonal(self) -> float:
        """Of one cell, in input units."""
        return float(np.linalg.norm(self.step))

    def corner_keys(self, index: Int[Array, "n 3"]) -> Int[Array, " n"]:
        """One number per corner, ascending in (z, y, x)."""
        return self._key(index, self.size + 1)

    def corner_index(self, keys: Int[Array, " n"]) -> Int[Array, "n 3"]:
        return self._index(keys, self.size + 1)

    def cell_keys(self, index: Int[Array, "n 3"], width: int) -> Int[Array, " n"]:
        """Keys of the cells that are `width` cells wide."""
        return self._key(index, self.size // width)

    def cell_index(self, keys: Int[Array, " n"], width: int) -> Int[Array, "n 3"]:
        return self._index(keys, self.size // width)

    def positions(self, index: Float[Array, "n 3"] | Int[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Points in input units; halves are the middles of cells."""
        return self.low + self.step * (index - 1)

    def within(self, index: Int[Array, "n 3"]) -> Bool[Array, " n"]:
        """Whether corners lie in the bounds, the border included."""
        return np.asarray(((index >= 1) & (index <= self.inner + 1)).all(axis=1))

    @staticmethod
    def _key(index: Int[Array, "n 3"], size: Int[Array, " 3"]) -> Int[Array, " n"]:
        return (index[:, 2] * size[1] + index[:, 1]) * size[0] + index[:, 0]

    @staticmethod
    def _index(keys: Int[Array, " n"], size: Int[Array, " 3"]) -> Int[Array, "n 3"]:
        rest, x = np.divmod(keys, size[0])
        z, y = np.divmod(rest, size[1])
        return np.stack([x, y, z], axis=1)


def distinct(keys: Int[Array, " n"]) -> Int[Array, " m"]:
    """The keys in ascending order, each once. numpy's unique hashes integers, which takes a hundred times as long."""
    ordered = np.sort(keys)
    return ordered[np.r_[True, ordered[1:] != ordered[:-1]]] if len(ordered) else ordered


ScalarField = Callable[[Float[Array, "n 3"]], Float[Array, " n"]]
"""Values at points in input units, negative inside; rows are independent."""


def evaluate(field: ScalarField, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Values of the field at any number of points.

    Raises:
        BaseMeshError: a value is not a number.
    """
    parts = [np.asarray(field(points[i : i + CHUNK]), dtype=np.float64) for i in range(0, len(points), CHUNK)]
    values = np.concatenate([part.reshape(-1) for part in parts]) if parts else np.zeros(0)
    if len(values) != len(points):
        raise BaseMeshError(f"the field returned {len(values)} values for {len(points)} points")
    if np.isnan(values).any():
        where = ", ".join(f"{x:.6g}" for x in points[np.isnan(values).argmax()])
        raise BaseMeshError(
            f"the field is not a number at {int(np.isnan(values).sum())} of {len(values)} points, first at ({where})"
        )
    return values
