"""Axis-aligned boxes, possibly unbounded: where a shape's field can be at or below a level."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


@dataclass(frozen=True)
class Box:
    """The points between two corners, in input units; faces at infinity are allowed, an empty box is too."""

    lower: Float[Array, "3"]
    upper: Float[Array, "3"]

    @staticmethod
    def around(points: Float[Array, "n 3"], margin: float = 0.0) -> Box:
        """Smallest box that holds `points`, grown by `margin`."""
        return Box(points.min(axis=0) - margin, points.max(axis=0) + margin)

    @staticmethod
    def everywhere() -> Box:
        return Box(np.full(3, -np.inf), np.full(3, np.inf))

    @staticmethod
    def nowhere() -> Box:
        return Box(np.full(3, np.inf), np.full(3, -np.inf))

    @property
    def empty(self) -> bool:
        return bool((self.lower > self.upper).any())

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.lower).all() and np.isfinite(self.upper).all())

    @property
    def longest_side(self) -> float:
        return float((self.upper - self.lower).max())

    @property
    def reach(self) -> float:
        """Largest distance of a point of the box from the origin."""
        return float(np.linalg.norm(np.maximum(np.abs(self.lower), np.abs(self.upper))))

    @property
    def corners(self) -> Float[Array, "8 3"]:
        return np.array(list(itertools.product(*zip(self.lower, self.upper, strict=True))))

    def grown(self, margin: float) -> Box:
        return self if self.empty else Box(self.lower - margin, self.upper + margin)

    def moved(self, offset: Float[Array, "3"]) -> Box:
        return Box(self.lower + offset, self.upper + offset)

    def scaled(self, factors: Float[Array, "3"]) -> Box:
        """The image under scaling about the origin; the factors are positive."""
        return Box(self.lower * factors, self.upper * factors)

    def turned(self, matrix: Float[Array, "3 3"]) -> Box:
        """A box that holds the image under a linear map (interval arithmetic; 0 times infinity counts as 0)."""
        if self.empty:
            return self
        ends = np.stack([self.lower, self.upper])[:, None, :]
        with np.errstate(invalid="ignore"):
            products = np.where(matrix == 0, 0.0, matrix * ends)
        return Box(products.min(axis=0).sum(axis=1), products.max(axis=0).sum(axis=1))


def hull(boxes: Iterable[Box]) -> Box:
    """Smallest box that holds all of them; empty ones count for nothing."""
    solid = [box for box in boxes if not box.empty]
    if not solid:
        return Box.nowhere()
    return Box(np.min([b.lower for b in solid], axis=0), np.max([b.upper for b in solid], axis=0))


def overlap(boxes: Iterable[Box]) -> Box:
    """The box of the points that lie in all of them; `Box.nowhere()` where there are none."""
    each = list(boxes)
    box = Box(np.max([b.lower for b in each], axis=0), np.min([b.upper for b in each], axis=0))
    return Box.nowhere() if box.empty else box
