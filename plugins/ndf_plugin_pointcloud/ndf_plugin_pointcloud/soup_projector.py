"""Projection onto the level set of triangles: the closest point where that is on it, a traced ray elsewhere."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.winding import WindingTree
from ndf_plugin_pointcloud.caps import take_caps
from ndf_plugin_pointcloud.landing import Landing, LandingProjector
from ndf_plugin_pointcloud.tracing_projector import TOLERANCE, TracingProjector
from ndf_plugin_pointcloud.triangles import Triangles

_ON_EDGE = 1e-9
"""Barycentric coordinates below this count as zero."""
_AT = 2.0
"""A ray that ends this many tolerances from the closest triangle ends on it."""


class SoupProjector(LandingProjector):
    """Lands on the closest triangle where w - 1/2 changes sign across it: the paper's ray with its direction made
    exact (App. C.3). Where it does not (inside of intersecting parts), and where the closest point is on the rim of
    a hole, the paper's direction is traced. Over holes the level set is a cap in free space: where w is near 1/2, its
    gradient is traced too. The nearest landing counts.
    """

    def __init__(self, soup: Triangles, tree: WindingTree, tracing: TracingProjector) -> None:
        """Hold the parts.

        Args:
            soup: oriented triangles.
            tree: their winding number.
            tracing: the paper's projector.
        """
        self._tree, self._tracing = tree, tracing
        self._size, self._tolerance = soup.size, TOLERANCE * soup.size
        self._triangles = TriangleBVH(soup.vertices, soup.faces)
        vectors = soup.area_vectors
        self._normals = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        self._open = soup.open_edges
        rim = np.zeros(len(soup.vertices), dtype=bool)
        rim[soup.faces[self._open]] = True
        rim[soup.faces[:, [1, 2, 0]][self._open]] = True
        self._rim = rim[soup.faces]

    def land(self, query: Float[Array, "n 3"], threads: int = 1) -> Landing:
        closest, face, weights = self._triangles.closest(query, threads)
        offset = query - closest
        distance = np.linalg.norm(offset, axis=1)
        above = np.einsum("nc,nc->n", offset, self._normals[face]) >= 0
        far = distance > 1e-3 * self._tolerance
        outwards = np.where(far & above, 1.0, -1.0)[:, None] * offset / np.maximum(distance, 1e-300)[:, None]
        outwards = np.where(far[:, None], outwards, self._normals[face])
        reach = distance + 2 * self._tolerance
        heights = np.where(above, distance, -distance)
        full = np.full(len(query), self._tolerance)
        way = self._tree.trace(query, outwards, heights, full, reach, self._tolerance, threads)
        hit = np.abs(np.abs(way) - distance) <= _AT * self._tolerance  # also false for NaN
        found, normals = np.where(hit[:, None], closest, query), outwards
        other = np.flatnonzero(~hit | self._on_rim(face, weights))
        if len(other):
            points, slopes, landed = self._tracing.land(query[other], threads)
            nearer = landed & (np.linalg.norm(points - query[other], axis=1) < np.where(hit, distance, np.inf)[other])
            found[other[nearer]], normals[other[nearer]] = points[nearer], slopes[nearer]
            hit[other[nearer]] = True
        landing = Landing(found, normals, hit)
        take_caps(landing, query, np.arange(len(query)), self._tree, self._size, self._tolerance, threads)
        return landing

    def _on_rim(self, face: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """Whether the closest point is on an edge with other than two triangles."""
        zero = weights < _ON_EDGE
        # The edge from corner i to the next is opposite to corner i + 2.
        edge = (self._open[face] & zero[:, [2, 0, 1]]).any(axis=1)
        corner = (zero.sum(axis=1) == 2) & (self._rim[face] & ~zero).any(axis=1)
        return edge | corner
