"""Projection to a fixed distance from points or triangles: onto the outer side of their dilation, or onto them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_plugin_pointcloud.landing import Landing, LandingProjector


class Closest(NamedTuple):
    """Answer of a search, one row per query."""

    points: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    """Unit; their sign means nothing unless the search says so."""
    distances: Float[Array, " n"]
    """To what is really there (`points` may be between samples)."""


ClosestSearch = Callable[[Float[Array, "n 3"], int], Closest]
"""``search(queries, threads)``: the closest point of a surface that may be open."""


class ClosestTriangles:
    """Closest points of any triangles."""

    def __init__(self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> None:
        self._tree = TriangleBVH(vertices, faces)
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        vectors = np.cross(b - a, c - a)
        self._normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    def __call__(self, queries: Float[Array, "n 3"], threads: int) -> Closest:
        points, face, _ = self._tree.closest(queries, threads)
        return Closest(points, self._normals[face], np.linalg.norm(queries - points, axis=1))


class ShellProjector(LandingProjector):
    """From the closest point straight back towards the query, to a given distance.

    The distance is what keeps the two sides of a sheet apart: without it both would land on the same points, and the
    closed surface around the sheet would have no inside. A query within a thousandth of the distance has no side: it
    goes along the normal. With distance 0, for what has an inside, queries land on the closest points themselves.

    Queries farther from everything than `limit` are over a gap and not converged.
    """

    def __init__(self, search: ClosestSearch, radius: float, limit: float) -> None:
        """Hold the search.

        Args:
            search: finds closest points.
            radius: distance to keep from them, input units; 0 needs a search whose normals point outwards.
            limit: most distance of a query from what is there.
        """
        self._search, self._radius, self._limit = search, radius, limit

    def land(self, query: Float[Array, "n 3"], threads: int = 1) -> Landing:
        closest = self._search(query, threads)
        offset = query - closest.points
        distance = np.linalg.norm(offset, axis=1, keepdims=True)
        sided = (distance > 1e-3 * self._radius) & (self._radius > 0)
        away = np.where(sided, offset / np.maximum(distance, 1e-300), closest.normals)
        return Landing(closest.points + self._radius * away, away, closest.distances <= self._limit)
