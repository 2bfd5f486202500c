"""The surface between points without normals: planes fitted to the nearest ones."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_pointcloud.shell import Closest

_WIDTH = 0.7
"""Standard deviation of the Gaussian, in root mean square distances to the neighbours."""
_PASSES = 2
"""Planes fitted for a query: at itself, then where the first one puts it."""
_BLOCK = 65_536


def plane_normals(
    points: Float[Array, "n k 3"], weights: Float[Array, "n k"]
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Weighted middle and unit normal (of either sign) of the plane closest to each row of points."""
    weights = weights / weights.sum(axis=1, keepdims=True)
    middle = np.einsum("nk,nkc->nc", weights, points)
    centred = points - middle[:, None]
    scatter = np.einsum("nk,nkc,nkd->ncd", weights, centred, centred)
    return middle, np.linalg.eigh(scatter)[1][:, :, 0]


class LocalPlanes:
    """Closest points on moving least squares planes: smoother than the nearest point itself, and between points.

    Reference: Alexa, Behr, Cohen-Or, Fleishman, Levin and Silva, Computing and rendering point set surfaces, 2003.
    """

    def __init__(
        self, points: Float[Array, "n 3"], neighbours: int, outwards: Float[Array, "n 3"] | None = None
    ) -> None:
        """Index the points.

        Args:
            points: distinct.
            neighbours: points that a plane is fitted to.
            outwards: a vector at each point that is on the outer side; without it, signs of normals mean nothing.
        """
        self._tree, self._points = KDTree(points), points
        self._count = min(neighbours, len(points))
        self._outwards = outwards

    def __call__(self, queries: Float[Array, "n 3"], threads: int) -> Closest:
        blocks = [self._block(queries[i : i + _BLOCK], threads) for i in range(0, max(len(queries), 1), _BLOCK)]
        return Closest(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))

    def _block(self, queries: Float[Array, "n 3"], threads: int) -> Closest:
        at, index, nearest = queries, np.zeros((len(queries), self._count), np.int64), np.zeros(len(queries))
        middle = normal = queries
        for turn in range(_PASSES):
            distance, index = self._tree.query(at, k=self._count, workers=threads)
            distance, index = np.asarray(distance), np.asarray(index)
            if not turn:
                nearest = distance[:, 0]
            squared = distance**2
            scale = 2 * _WIDTH**2 * np.maximum(squared.mean(axis=1, keepdims=True), 1e-300)
            middle, normal = plane_normals(self._points[index], np.exp(-squared / scale))
            at = queries - np.einsum("nc,nc->n", queries - middle, normal)[:, None] * normal
        if self._outwards is not None:
            side = np.einsum("nc,nc->n", normal, self._outwards[index[:, 0]])
            normal = np.where(side < 0, -1.0, 1.0)[:, None] * normal
        return Closest(at, normal, nearest)


def point_normals(
    points: Float[Array, "n 3"], neighbours: int, threads: int = 1
) -> tuple[Float[Array, "n 3"], Int[Array, "n k"]]:
    """Unit normals, of either sign, of planes through each point's neighbours; also these."""
    count = min(neighbours + 1, len(points))
    index = np.asarray(KDTree(points).query(points, k=count, workers=threads)[1])
    normals = [
        plane_normals(points[index[i : i + _BLOCK]], np.ones((len(index[i : i + _BLOCK]), count)))[1]
        for i in range(0, len(points), _BLOCK)
    ]
    return np.concatenate(normals), index
