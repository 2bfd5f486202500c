"""How much surface each point stands for."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

NEIGHBOURS = 20
_AWAY = -0.5
"""Cosine between normals; across the edge of a cube it is 0, and there both faces share one disc."""
_BLOCK = 65_536
_LARGEST = 25.0
"""Most area of a point, in medians: outliers stand for little."""


def point_areas(tree: KDTree, normals: Float[Array, "n 3"], threads: int = 1) -> Float[Array, " n"]:
    """Area of each point of the tree, from the disc that holds its 20 nearest neighbours: pi r^2 / 20.

    The point itself is in the disc too, so of 21 points with one on the rim 20 count. Those that face away do not:
    they are in another disc, on the other side of a thin part, and with them both sides would be half as large.

    Args:
        tree: of distinct points.
        normals: unit.
        threads: for the search.
    """
    points = np.asarray(tree.data)
    count = min(NEIGHBOURS, len(points) - 1)
    area = np.empty(len(points))
    for start in range(0, len(points), _BLOCK):
        rows = slice(start, start + _BLOCK)
        distance, index = (np.asarray(x) for x in tree.query(points[rows], k=count + 1, workers=threads))
        likeness = np.einsum("nkc,nc->nk", normals[index[:, :count]], normals[rows])
        area[rows] = np.pi * distance[:, -1] ** 2 / np.maximum((likeness > _AWAY).sum(axis=1), 1)
    return np.minimum(area, _LARGEST * np.median(area))
