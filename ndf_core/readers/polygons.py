"""What a reader returns, and polygons cut into triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array


@dataclass(frozen=True)
class RawMesh:
    """Triangles as the file has them: nothing merged, dropped or checked but the shapes of the arrays."""

    vertices: Float[Array, "v 3"]
    """float64."""
    faces: Int[Array, "f 3"]
    """int64; indices may be out of range."""
    notes: tuple[str, ...] = ()


def fans(corners: Int[Array, " n"], sizes: Int[Array, " p"]) -> tuple[Int[Array, "f 3"], tuple[str, ...]]:
    """Cut polygons into fans around their first corners.

    Args:
        corners: the polygons' corners, one polygon after the other.
        sizes: corners of each polygon.

    Returns:
        Triangles, and a note if there were larger polygons.

    Raises:
        ValueError: a polygon has fewer than three corners.
    """
    if len(sizes) and sizes.min() < 3:
        raise ValueError(f"face {int(sizes.argmin()) + 1} has {int(sizes.min())} corners")
    if not len(sizes) or sizes.max() == 3:
        return corners.reshape(-1, 3), ()
    first = np.cumsum(sizes) - sizes
    pieces = sizes - 2
    polygon = np.repeat(np.arange(len(sizes)), pieces)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    start = first[polygon]
    triangles = np.stack([corners[start], corners[start + step + 1], corners[start + step + 2]], axis=1)
    return triangles, (f"{int((sizes > 3).sum()):,} polygons cut into triangles",)


def strip_triangles(strip: Int[Array, " n"]) -> Int[Array, "f 3"]:
    """Triangles of a strip; every other one is turned, and -1 starts a new strip."""
    triangles = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
    breaks = np.flatnonzero(strip < 0)
    starts = np.concatenate([[0], breaks + 1])
    position = np.arange(len(triangles)) - starts[np.searchsorted(breaks, np.arange(len(triangles)), side="left")]
    odd = position % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    return triangles[(triangles >= 0).all(axis=1)]
