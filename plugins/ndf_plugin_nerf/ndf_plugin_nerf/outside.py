"""What of space is outside of a solid: what a flood from beyond the grid reaches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int
from numpy import ndarray as Array
from scipy import ndimage


def flooded(empty: Bool[Array, "x y z"], clearance: int = 0) -> Bool[Array, "x y z"]:
    """The nodes of `empty` that a flood from beyond the grid reaches from neighbour to neighbour.

    Args:
        empty: nodes without matter.
        clearance: the flood keeps so many nodes away from matter until it has come to rest, and then flows back that
            far: it passes no gap narrower than twice this, and does not fill such gaps.
    """
    room = np.pad(empty, clearance + 1, constant_values=True)
    free = np.logical_not(ndimage.binary_dilation(~room, iterations=clearance)) if clearance else room
    label = connected(free)
    reached = label == label[0, 0, 0]
    if clearance:
        reached = ndimage.binary_dilation(reached, iterations=clearance, mask=room)
    inner = slice(clearance + 1, -clearance - 1)
    return np.ascontiguousarray(reached[inner, inner, inner])


def connected(mask: Bool[Array, "x y z"]) -> Int[Array, "x y z"]:
    """Number of the part that each node of a mask is in, from 1; 0 elsewhere. Neighbours are those along the axes."""
    found: Any = ndimage.label(mask)
    return found[0]


@dataclass(frozen=True)
class Parts:
    """Connected parts of a solid."""

    label: Int[Array, "x y z"]
    """0 outside, then 1, 2, ... from the largest to the smallest."""
    sizes: Int[Array, " c"]
    """Nodes of each, in that order."""

    def of_share(self, least: float) -> int:
        """How many have at least that share of the largest one's nodes."""
        return int((self.sizes >= least * self.sizes[0]).sum()) if len(self.sizes) else 0


def parts_of(solid: Bool[Array, "x y z"]) -> Parts:
    """The parts of a solid, the largest first."""
    label = connected(solid)
    sizes = np.bincount(label.ravel())[1:]
    order = np.argsort(-sizes, kind="stable")
    rank = np.zeros(len(sizes) + 1, dtype=np.int32)
    rank[order + 1] = np.arange(1, len(sizes) + 1)
    return Parts(rank[label], sizes[order])


def box_of(part: Bool[Array, "x y z"]) -> Int[Array, "2 3"]:
    """First and last node of a part along each axis; it is not empty."""
    ends: list[tuple[int, int]] = []
    for axis in range(3):
        used = np.flatnonzero(part.any(axis=tuple(other for other in range(3) if other != axis)))
        ends.append((int(used[0]), int(used[-1])))
    return np.array(ends).T
