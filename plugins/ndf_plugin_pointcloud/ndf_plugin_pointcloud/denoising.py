"""Noise taken off points with normals before their winding number is asked for: thin parts keep their two sides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_pointcloud.areas import PointAreas
from ndf_plugin_pointcloud.frames import axes_of

_NEIGHBOURS = 32
"""That a quadric is fitted to: more are nearer on smooth shapes and flatten detailed ones."""
_LOOKED_AT = 2
"""Times as many are looked at for those that face the same way."""
_ALIKE = 0.5
"""Least cosine between normals that face the same way; weights begin there, so that sharp edges stay."""
_WIDTH = 0.7
"""Standard deviation of the Gaussian, in root mean square distances to the neighbours."""
_STIFFNESS = 1e-6
"""Of the quadrics, so that few neighbours determine one too."""
_ENOUGH = 0.5
"""Points are moved while they scatter more than this, in radii of their discs: 0.4 was found with noise of 0.2% of
the size on 20,000 points, which smoothing alone treats as well; 0.7 to 0.9 with 0.5%."""
_PASSES = 6
"""Most. One does for noise as wide as the discs, four for noise of three times that."""
_MEDIAN = 0.6745
"""Median of the distances from the mean, of a normal distribution of deviation 1."""
_BLOCK = 2048


class OrientedPoints(NamedTuple):
    """Points with normals, and what they stand for."""

    tree: KDTree
    """Of the points."""
    normals: Float[Array, "n 3"]
    areas: Float[Array, " n"]

    @property
    def radii(self) -> Float[Array, " n"]:
        """Of discs of these areas."""
        return np.sqrt(self.areas / np.pi)


def without_noise(cloud: OrientedPoints, point_areas: PointAreas, threads: int = 1) -> OrientedPoints:
    """Move points onto quadrics through their neighbours, again and again until they scatter little.

    A winding number averages noise over balls, and over both sides of what is thinner than these. Here only points
    that face the same way count, so a plate may be as thin as its noise.

    Args:
        cloud: distinct points, unit normals. Returned itself where it scatters little.
        point_areas: measures the areas of the points that moved.
        threads: for the search.
    """
    for _ in range(_PASSES):
        points, normals = _on_quadrics(cloud.tree, cloud.normals, threads)
        offsets = np.abs(np.einsum("nc,nc->n", points - np.asarray(cloud.tree.data), normals))
        if np.median(offsets / cloud.radii) < _MEDIAN * _ENOUGH:
            break
        tree = KDTree(points)
        cloud = OrientedPoints(tree, normals, point_areas(tree, normals, threads))
    return cloud


def _on_quadrics(
    tree: KDTree, normals: Float[Array, "n 3"], threads: int
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Each point of the tree moved along its neighbours' mean normal, and the normal there.

    Quadrics are fitted to heights and to normals: noise of a height is as wide as the points are apart where this is
    needed, and normals say more about slope and curvature. In units of the neighbourhood's size both weigh the same.
    """
    points = np.asarray(tree.data)
    count = min(_LOOKED_AT * _NEIGHBOURS, len(points))
    found, turned = np.empty_like(points), np.empty_like(points)
    for start in range(0, len(points), _BLOCK):
        rows = slice(start, start + _BLOCK)
        distance, index = (np.asarray(x) for x in tree.query(points[rows], k=count, workers=threads))
        squared, nearby = distance**2, normals[index]
        alike = np.einsum("nkc,nc->nk", nearby, normals[rows]) > _ALIKE
        alike &= alike.cumsum(axis=1) <= _NEIGHBOURS
        mean = (alike * squared).sum(axis=1) / alike.sum(axis=1)
        # A point that nobody agrees with has only itself.
        size = np.sqrt(np.maximum(mean, squared[:, -1] / count))[:, None]
        weights = alike * np.exp(-squared / (2 * _WIDTH**2 * size**2))
        outwards = np.einsum("nk,nkc->nc", weights, nearby)
        outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
        axes = axes_of(outwards)
        facing = nearby @ axes
        weights *= np.clip((facing[:, :, 0] - _ALIKE) / (1 - _ALIKE), 0, None)
        local = (points[index] - points[rows, None]) @ axes / size[:, :, None]
        slopes = -facing[:, :, 1:] / np.maximum(facing[:, :, :1], _ALIKE)
        height, slope = _quadric(local, slopes, weights)
        # Beside a lone point a quadric is a guess.
        found[rows] = points[rows] + np.clip(height, -1, 1)[:, None] * size * outwards
        normal = outwards - np.einsum("nca,na->nc", axes[:, :, 1:], slope)
        turned[rows] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return found, turned


def _quadric(
    local: Float[Array, "n k 3"], slopes: Float[Array, "n k 2"], weights: Float[Array, "n k"]
) -> tuple[Float[Array, " n"], Float[Array, "n 2"]]:
    """Height and slope at 0 of the quadric that has heights (the first coordinate) and slopes over the other two."""
    u, v = local[:, :, 1], local[:, :, 2]
    one, none = np.ones_like(u), np.zeros_like(u)
    terms = np.concatenate(
        [
            np.stack([one, u, v, u * u / 2, u * v, v * v / 2], axis=2),
            np.stack([none, one, none, u, v, none], axis=2),
            np.stack([none, none, one, none, u, v], axis=2),
        ],
        axis=1,
    )
    values = np.concatenate([local[:, :, 0], slopes[:, :, 0], slopes[:, :, 1]], axis=1)
    weighted = (terms * np.tile(weights, 3)[:, :, None]).transpose(0, 2, 1)
    normal = weighted @ terms + _STIFFNESS * np.maximum(weights.sum(axis=1), 1e-300)[:, None, None] * np.eye(6)
    solved = np.linalg.solve(normal, weighted @ values[:, :, None])[:, :, 0]
    return solved[:, 0], solved[:, 1:3]
