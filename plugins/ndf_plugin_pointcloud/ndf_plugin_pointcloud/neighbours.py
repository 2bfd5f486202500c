"""How many neighbours a surface through points without normals has to look at, for the noise that they have."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

_LOOKED_AT = 2000
"""Points that are enough for a median."""
_FIRST = (24, 48, 96)
"""Neighbourhoods that scatter is measured in, and in four times as many points."""
_RELIABLE = 0.75
"""More neighbours than this share of the smaller neighbourhood: noise is wider than it, and hides its plane."""
_BALANCE = 1.5
"""Fitted to landing errors on four shapes."""
PLANE_NEIGHBOURS = 12
_LEAST, _MOST = 16, 150


def noise_and_neighbours(points: Float[Array, "n 3"], threads: int = 1) -> tuple[float, float]:
    """Noise along the normal (standard deviation, input units), and how many points a plane should be fitted to.

    Squared scatter about the plane of k points is s^2 + (b k)^2: noise, and curvature over an area proportional to k.
    Two neighbourhoods give both. The plane's own error is about s^2 / k from noise and (b k)^2 from curvature, least
    where k^3 = s^2 / (2 b^2), up to a factor.

    Args:
        points: distinct.
        threads: for the search.
    """
    tree = KDTree(points)
    rows = np.linspace(0, len(points) - 1, min(len(points), _LOOKED_AT)).astype(np.int64)
    noise, wanted = 0.0, 0.0
    for small in _FIRST:
        if 4 * small > len(points):
            break
        near = np.asarray(tree.query(points[rows], k=4 * small, workers=threads)[1])
        inner, outer = (_scatter(points, near[:, :count]) for count in (small, 4 * small))
        noise = max(16 * inner - outer, 0.0) / 15
        curved = max(outer - inner, 0.0) / (15 * small**2)
        wanted = min(_BALANCE * (noise / max(2 * curved, 1e-300)) ** (1 / 3), _MOST)
        if wanted <= _RELIABLE * small:
            break
    return float(np.sqrt(noise)), float(wanted)


def quadric_neighbours(wanted: float) -> int:
    """Points for a quadric, from those that a plane should have: it follows curvature, and can look farther.

    16 for clean points (curvature that no parabola fits looks like noise worth up to 11), then up to three times as
    many as for a plane.
    """
    return round(float(np.clip(min(5 * wanted - 40, 3 * wanted), _LEAST, _MOST)))


def _scatter(points: Float[Array, "n 3"], index: Int[Array, "m k"]) -> float:
    """Median squared distance to the plane of each row's points (the smallest eigenvalue, unbiased)."""
    offsets = points[index] - points[index].mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(offsets.transpose(0, 2, 1) @ offsets)[:, 0]
    return float(np.median(squares)) / (index.shape[1] - 3)
