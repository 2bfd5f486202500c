"""Heights on a regular grid, read from an ESRI ASCII grid."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ndf_core.errors import InputError
from numpy import ndarray as Array

_MOST_BYTES = 1 << 28
_FEWEST = 2
"""Rows and columns."""


@dataclass(frozen=True)
class Terrain:
    """Heights at the centres of square cells."""

    heights: Array
    """float64 (rows, columns), from south to north and from west to east."""
    corner: tuple[float, float]
    """x and y of the south-western centre."""
    spacing: float


def read_terrain(path: Path) -> Terrain:
    """Read a file.

    Raises:
        InputError: it is no ESRI ASCII grid, or has cells without data.
    """
    if path.stat().st_size > _MOST_BYTES:
        raise InputError(f"{path}: longer than {_MOST_BYTES} bytes; cut it into tiles")
    try:
        words = path.read_text("ascii").split()
        named = next(i for i in range(0, len(words), 2) if not words[i][0].isalpha())
        header = {name.lower(): float(value) for name, value in zip(words[:named:2], words[1:named:2], strict=True)}
        columns, rows, spacing = int(header["ncols"]), int(header["nrows"]), header["cellsize"]
        heights = np.array(words[named:], dtype=np.float64).reshape(rows, columns)[::-1]
        half = spacing / 2  # a corner lies half a cell before the first centre
        x = header["xllcenter"] if "xllcenter" in header else header["xllcorner"] + half
        y = header["yllcenter"] if "yllcenter" in header else header["yllcorner"] + half
    except (ValueError, KeyError, StopIteration) as error:
        raise InputError(f"{path}: is no ESRI ASCII grid: {type(error).__name__}: {error}") from error
    if min(rows, columns) < _FEWEST or not np.isfinite([x, y, spacing]).all() or spacing <= 0:
        raise InputError(f"{path}: need at least 2 x 2 heights, a finite corner and a positive cellsize")
    missing = ~np.isfinite(heights) | (heights == header.get("nodata_value", np.nan))
    if missing.any():
        raise InputError(f"{path}: {int(missing.sum())} cells have no data; fill them first")
    return Terrain(heights, (x, y), spacing)


def solid(terrain: Terrain, depth: float) -> tuple[Array, Array]:
    """The closed mesh of the ground, a flat bottom `depth` below its lowest point, and four walls.

    The ground between four heights is four triangles about their mean: two about a diagonal would make another
    surface of a terrain that is turned.

    Returns:
        Vertices (v, 3) and faces (f, 3), counter-clockwise seen from outside.
    """
    heights = terrain.heights
    means = (heights[:-1, :-1] + heights[:-1, 1:] + heights[1:, 1:] + heights[1:, :-1]) / 4
    ground, middles = _placed(terrain, heights, 0.0), _placed(terrain, means, 0.5)
    bottom = ground * [1.0, 1.0, 0.0] + [0.0, 0.0, heights.min() - depth]
    index = np.arange(heights.size).reshape(heights.shape)
    corners = [part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])]
    middle = heights.size + np.arange(means.size)
    top = [np.column_stack([corners[i], corners[(i + 1) % 4], middle]) for i in range(4)]
    under = heights.size + means.size
    a, b, c, d = (part + under for part in corners)
    base = [np.column_stack([a, c, b]), np.column_stack([a, d, c])]
    # Once around the rim, counter-clockwise seen from above.
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    ahead, below = np.roll(rim, -1), rim + under
    walls = [np.column_stack([rim, below, ahead]), np.column_stack([ahead, below, np.roll(below, -1)])]
    return np.concatenate([ground, middles, bottom]), np.concatenate([*top, *base, *walls])


def _placed(terrain: Terrain, heights: Array, shift: float) -> Array:
    """Points (n, 3) of heights that lie `shift` cells from the corner."""
    y, x = np.meshgrid(*(np.arange(count) + shift for count in heights.shape), indexing="ij")
    return np.column_stack([np.stack([x, y], -1).reshape(-1, 2) * terrain.spacing + terrain.corner, heights.ravel()])
