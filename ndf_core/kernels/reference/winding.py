"""Winding numbers source by source: what `kernels.winding` approximates."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


def winding_of_triangles(queries: Float[Array, "n 3"], corners: Float[Array, "f 3 3"]) -> Float[Array, " n"]:
    """Sum of the triangles' solid angles over 4 pi (van Oosterom and Strackee 1983)."""
    values = np.empty(len(queries))
    for row, query in enumerate(queries):
        a, b, c = (corners[:, i] - query for i in range(3))
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        values[row] = np.arctan2(above, below).sum() / (2 * np.pi)
    return values


def winding_of_points(
    queries: Float[Array, "n 3"],
    points: Float[Array, "m 3"],
    area_vectors: Float[Array, "m 3"],
    radii: Float[Array, " m"],
) -> Float[Array, " n"]:
    """Sum of the fields of dipoles, each spread over its ball with a density in proportion to 1 - (r / R)^2.

    Of a spread charge, the ball of radius r < R holds the share (5 (r/R)^3 - 3 (r/R)^5) / 2.
    """
    values = np.empty(len(queries))
    for row, query in enumerate(queries):
        offset = points - query
        distance = np.linalg.norm(offset, axis=1)
        inside = distance < radii
        share = np.where(inside, (5 - 3 * (distance / radii) ** 2) / (2 * radii**3), 1.0)
        factor = np.where(inside, share, np.divide(1.0, distance**3, out=np.ones_like(distance), where=~inside))
        values[row] = (np.einsum("ij,ij->i", area_vectors, offset) * factor).sum() / (4 * np.pi)
    return values
