"""Caps: where the level set w = 1/2 spans a hole in free space, away from every sample."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.winding import WindingTree
from ndf_plugin_pointcloud.landing import Landing

_UNSURE = 0.25
"""Queries with w this near to 1/2 may be next to a cap: beside samples that close up w is about 0 or 1."""


def take_caps(
    landing: Landing,
    query: Float[Array, "n 3"],
    rows: Int[Array, " k"],
    tree: WindingTree,
    size: float,
    tolerance: float,
    threads: int,
) -> None:
    """Replace landings, in place, by those on caps that are nearer: along the gradient of w, where w is near 1/2.

    Args:
        landing: of each query so far.
        query: input units.
        rows: the queries that may be next to a cap.
        tree: w.
        size: longest side of the surface; those that have not landed look so far.
        tolerance: of the sign change of w - 1/2, input units.
        threads: for the field.
    """
    w = tree.values(query[rows], threads)
    unsure = np.abs(w - 0.5) < _UNSURE
    rows, w = rows[unsure], w[unsure]
    if not len(rows):
        return
    here = query[rows]
    gradients = tree.values_and_gradients(here, threads)[1]
    steepness = np.linalg.norm(gradients, axis=1)
    safe = np.maximum(steepness, 1e-300)
    slopes, heights = -gradients / safe[:, None], (0.5 - w) / safe
    reaches = np.where(landing.landed[rows], np.linalg.norm(landing.points[rows] - here, axis=1), size)
    steps = np.minimum(np.abs(heights), reaches)
    way = tree.trace(here, slopes, heights, steps, reaches, tolerance, threads)
    nearer = (np.abs(way) < reaches) & (steepness > 0)  # also false for NaN
    rows, way, slopes = rows[nearer], way[nearer], slopes[nearer]
    landing.points[rows] = query[rows] + way[:, None] * slopes
    landing.normals[rows], landing.landed[rows] = slopes, True
