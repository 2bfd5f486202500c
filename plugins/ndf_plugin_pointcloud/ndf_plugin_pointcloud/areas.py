"""How much surface each point stands for."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

NEIGHBOURS = 20
_LARGEST = 25.0
"""Most area of a point, in medians: outliers stand for little."""


def point_areas(tree: KDTree, threads: int = 1) -> Float[Array, " n"]:
    """Area of each point of the tree, from the disc that holds its 20 nearest neighbours: pi r^2 / 20.

    The point itself is in the disc too, so of 21 points with one on the rim 20 count.

    Args:
        tree: of distinct points.
        threads: for the search.
    """
    points = np.asarray(tree.data)
    count = min(NEIGHBOURS, len(points) - 1)
    distance = np.asarray(tree.query(points, k=count + 1, workers=threads)[0])[:, -1]
    area = np.pi * distance**2 / count
    return np.minimum(area, _LARGEST * np.median(area))
