"""Planes and discs through points without normals: sheets that end where their points do, and normals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_pointcloud.ellipse import within_ellipse
from ndf_plugin_pointcloud.shell import Closest

_WIDTH = 0.7
"""Standard deviation of the Gaussian, in root mean square distances to the neighbours."""
_REACH = 1.5
"""Half axes of a disc, in standard deviations of its points. Even samples of a disc have 2; with this much the discs
of a sampled sheet overlap, and that of a curve is hardly wider than the curve."""
AWAY = 1e-6
"""Weight of neighbours that face away, so that there are always some."""
_BLOCK = 65_536


class Discs(NamedTuple):
    """Planes through weighted points, one a row, and how far the points spread in them."""

    middles: Float[Array, "n 3"]
    axes: Float[Array, "n 3 3"]
    """Unit columns: the normal (of either sign), then the directions of the smaller and the larger spread."""
    spreads: Float[Array, "n 2"]
    """Standard deviations along these two."""

    @classmethod
    def through(cls, points: Float[Array, "n k 3"], weights: Float[Array, "n k"]) -> Discs:
        """Fit one to each row of points."""
        weights = weights / weights.sum(axis=1, keepdims=True)
        middles = np.einsum("nk,nkc->nc", weights, points)
        centred = points - middles[:, None]
        scatter = np.einsum("nk,nkc,nkd->ncd", weights, centred, centred)
        squares, axes = np.linalg.eigh(scatter)
        return cls(middles, axes, np.sqrt(np.maximum(squares[:, 1:], 0)))

    def feet(self, queries: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Closest points of the discs."""
        places = np.einsum("nc,nca->na", queries - self.middles, self.axes[:, :, 1:])
        places = within_ellipse(places, _REACH * self.spreads)
        return self.middles + np.einsum("na,nca->nc", places, self.axes[:, :, 1:])


class LocalDiscs:
    """Closest points on moving least squares planes that end where their points do: a sheet then has rims, and points
    along a curve are no ribbon.

    The disc at the nearest point says where to look, the disc through the points around there is the answer.

    Reference: Alexa, Behr, Cohen-Or, Fleishman, Levin and Silva, Computing and rendering point set surfaces, 2003.
    """

    def __init__(self, points: Float[Array, "n 3"], neighbours: int, threads: int = 1) -> None:
        """Index the points, which are distinct; discs are fitted to so many neighbours."""
        self._tree, self._points = KDTree(points), points
        self._count = min(neighbours, len(points))
        blocks = [self._around(points[i : i + _BLOCK], threads) for i in range(0, len(points), _BLOCK)]
        self._at_points = Discs(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))

    @property
    def flatness(self) -> float:
        """Median ratio of the discs' half axes: nearly 1 on a sheet, 0 along a curve."""
        smaller, larger = self._at_points.spreads.T
        return float(np.median(smaller / np.maximum(larger, 1e-300)))

    def __call__(self, queries: Float[Array, "n 3"], threads: int) -> Closest:
        blocks = [self._block(queries[i : i + _BLOCK], threads) for i in range(0, max(len(queries), 1), _BLOCK)]
        return Closest(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))

    def _block(self, queries: Float[Array, "n 3"], threads: int) -> Closest:
        distance, index = (np.asarray(rows) for rows in self._tree.query(queries, workers=threads))
        near = Discs(*(rows[index] for rows in self._at_points)).feet(queries)
        discs = self._around(near, threads)
        return Closest(discs.feet(queries), discs.axes[:, :, 0], distance)

    def _around(self, places: Float[Array, "n 3"], threads: int) -> Discs:
        """Discs through the points nearest to places."""
        distance, index = self._tree.query(places, k=self._count, workers=threads)
        squared = np.asarray(distance).reshape(len(places), self._count) ** 2
        index = np.asarray(index).reshape(len(places), self._count)
        scale = 2 * _WIDTH**2 * np.maximum(squared.mean(axis=1, keepdims=True), 1e-300)
        return Discs.through(self._points[index], np.exp(-squared / scale))


def point_normals(
    points: Float[Array, "n 3"], neighbours: int, threads: int = 1
) -> tuple[Float[Array, "n 3"], Int[Array, "n k"]]:
    """Unit normals, of either sign, of planes through each point's neighbours; also these."""
    count = min(neighbours + 1, len(points))
    index = np.asarray(KDTree(points).query(points, k=count, workers=threads)[1])
    rows = [index[i : i + _BLOCK] for i in range(0, len(points), _BLOCK)]
    normals = [Discs.through(points[block], np.ones(block.shape)).axes[:, :, 0] for block in rows]
    return np.concatenate(normals), index
