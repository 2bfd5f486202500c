"""How far points with normals scatter about their surface, and how much to smooth for that."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

_NEIGHBOURS = 8
_ALONE = 1e-9
"""Weight of neighbours that face away, so that there are always some."""
_LOOKED_AT = 20_000
"""Points that are enough for a median."""
_SMOOTHING = 6.0
"""Radius over which a normal is spread, for each unit of noise."""
_LEAST, _MOST = 1.0, 2.0
_CLEAN = 0.25
"""Noise below this is curvature: up to 0.19 was seen on detailed shapes, 0.32 with noise of 0.2% of the size."""


def noise_level(tree: KDTree, normals: Float[Array, "n 3"], radii: Float[Array, " n"], threads: int = 1) -> float:
    """Median distance of a point, along its normal, from the middle of its eight neighbours, in radii of its disc.

    Neighbours that face away are on the other side of a thin part, and do not count.

    Curvature alone gives 0.05 to 0.19 with 20,000 points on a detailed shape, noise of the radius 0.5 to 0.6.

    Args:
        tree: of the points.
        normals: unit.
        radii: of the disc that each point stands for.
        threads: for the search.
    """
    points = np.asarray(tree.data)
    rows = np.linspace(0, len(points) - 1, min(len(points), _LOOKED_AT)).astype(np.int64)
    count = min(_NEIGHBOURS, len(points) - 1)
    index = np.asarray(tree.query(points[rows], k=count + 1, workers=threads)[1])[:, 1:]
    agreement = np.maximum(np.einsum("nkc,nc->nk", normals[index], normals[rows]), 0)
    agreement += _ALONE
    middle = np.einsum("nk,nkc->nc", agreement / agreement.sum(axis=1, keepdims=True), points[index])
    offsets = points[rows] - middle
    return float(np.median(np.abs(np.einsum("nc,nc->n", offsets, normals[rows])) / radii[rows]))


def is_clean(noise: float) -> bool:
    """Whether neighbours scatter no more than on a detailed shape."""
    return noise < _CLEAN


def smoothing_for(noise: float) -> float:
    """Radius over which normals are spread, in radii of the discs: 1 for clean points, 2 for noisy ones.

    Measured (docs/architecture/pointcloud_plugin.md): less than 1 gains nothing worth the rougher field, and noisier
    points than the discs are wide are not told apart by their neighbours.
    """
    return float(np.clip(_SMOOTHING * noise, _LEAST, _MOST))
