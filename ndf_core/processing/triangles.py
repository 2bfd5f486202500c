"""Triangles from their edge lengths alone. Edge i of a face runs from corner i to corner i + 1."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

_THINNEST = 1e-8
"""Least excess of two edges over the third, as a share of the mean edge."""


def mollified(lengths: Float[Array, "f 3"]) -> Float[Array, "f 3"]:
    """Lengths for which every triangle has an area: all of them are lengthened by one and the same tiny amount.

    Law: where no triangle is degenerate, nothing changes.

    Reference: Sharp and Crane 2020, Sec. 4.5.
    """
    excess = lengths.sum(axis=1, keepdims=True) - 2 * lengths
    missing = _THINNEST * lengths.mean() - excess.min()
    return lengths + missing if missing > 0 else lengths


def areas(lengths: Float[Array, "f 3"]) -> Float[Array, " f"]:
    """Area of each triangle by Kahan's form of Heron's formula, which keeps its digits for needles."""
    c, b, a = np.sort(lengths, axis=1).T
    return 0.25 * np.sqrt(np.maximum((a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c)), 0.0))


def cotangents(lengths: Float[Array, "f 3"], area: Float[Array, " f"]) -> Float[Array, "f 3"]:
    """Cotangent of the angle opposite each edge. Every area must be positive."""
    square = lengths**2
    return (square.sum(axis=1, keepdims=True) - 2 * square) / (4 * area[:, None])


def corners_in_plane(lengths: Float[Array, "f 3"], area: Float[Array, " f"]) -> Float[Array, "f 3 2"]:
    """Each triangle in the plane: corner 0 at the origin, corner 1 on the x axis, corner 2 above it.

    This is the frame that tangent vectors of a face are given in.
    """
    first, second, third = lengths.T
    corners = np.zeros((len(lengths), 3, 2))
    corners[:, 1, 0] = first
    corners[:, 2, 0] = (first**2 + third**2 - second**2) / (2 * first)
    corners[:, 2, 1] = 2 * area / first
    return corners
