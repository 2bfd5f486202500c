"""Where the surface is from a point: the paper's direction, and a guess of the height along it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

NEIGHBOURS = 8
"""Sec. 4.2."""
_WIDTH = 0.7
"""Standard deviation of the Gaussian, in root mean square distances to the eight neighbours."""


class Directions(NamedTuple):
    """One row per query."""

    outwards: Float[Array, "n 3"]
    """Unit vectors."""
    heights: Float[Array, " n"]
    """Over the plane through the neighbours' weighted mean, input units."""
    distances: Float[Array, " n"]
    """To the nearest neighbour."""
    spacings: Float[Array, " n"]
    """Radius of the disc that the nearest neighbour stands for."""


class Neighbourhood:
    """Oriented samples of a surface, searched for the eight nearest."""

    def __init__(self, tree: KDTree, normals: Float[Array, "m 3"], radii: Float[Array, " m"]) -> None:
        """Hold the samples.

        Args:
            tree: of the samples.
            normals: outwards, unit.
            radii: of the disc that each sample stands for.
        """
        self._tree, self._normals, self._radii = tree, normals, radii
        self._points = np.asarray(tree.data)

    def directions(self, queries: Float[Array, "n 3"], threads: int) -> Directions:
        """Normals of the eight nearest samples, weighted by a Gaussian of their distance.

        Samples that face away from the nearest one count for nothing: they are on the other side of a thin part.

        Reference: Sec. 4.2.
        """
        count = min(NEIGHBOURS, len(self._points))
        distance, index = self._tree.query(queries, k=count, workers=threads)
        distance, index = np.asarray(distance).reshape(-1, count), np.asarray(index).reshape(-1, count)
        squared = distance**2
        scale = 2 * _WIDTH**2 * np.maximum(squared.mean(axis=1, keepdims=True), 1e-300)
        normals = self._normals[index]
        agreement = np.einsum("nkc,nc->nk", normals, normals[:, 0])
        weights = np.exp(-squared / scale) * np.maximum(agreement, 0)
        weights /= weights.sum(axis=1, keepdims=True)
        outwards = np.einsum("nk,nkc->nc", weights, normals)
        outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
        middle = np.einsum("nk,nkc->nc", weights, self._points[index])
        heights = np.einsum("nc,nc->n", queries - middle, outwards)
        return Directions(outwards, heights, distance[:, 0], self._radii[index[:, 0]])
