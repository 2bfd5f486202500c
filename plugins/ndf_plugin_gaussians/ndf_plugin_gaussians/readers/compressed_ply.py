"""PlayCanvas' compressed .ply: chunks of 256 splats, each with its own ranges, and four 32-bit words per splat.

Reference: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/ply/#compressed-ply-format
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.readers.ply_tables import Column, read_ply_tables
from ndf_plugin_gaussians.readers.smallest_three import from_smallest_three
from ndf_plugin_gaussians.splats import Splats, make_splats

CHUNK = 256
"""Splats that share ranges."""
_POSITION_BITS = ((21, 11), (11, 10), (0, 11))
_COLOUR_BITS = ((24, 8), (16, 8), (8, 8))


def read_compressed_ply(data: bytes) -> tuple[Splats, int]:
    """Splats, and the number of those left out as not finite.

    Chunks have 12 columns (ranges of positions and of log scales), or 18 (of colours as well).

    Raises:
        ValueError: a column is missing, chunks and splats do not match, or the file is no valid PLY.
    """
    tables = read_ply_tables(data)
    chunk, vertex = tables.get("chunk", {}), tables.get("vertex", {})
    position, rotation, scale, colour = (
        _words(vertex, f"packed_{name}") for name in ("position", "rotation", "scale", "color")
    )
    count, chunks = len(position), len(_range(chunk, "min_x"))
    if chunks != -(-count // CHUNK):
        raise ValueError(f"{count:,} splats need {-(-count // CHUNK):,} chunks of {CHUNK}, it has {chunks:,}")
    owner = np.arange(count) // CHUNK
    colours = _unpack(colour, _COLOUR_BITS)
    if "min_r" in chunk:
        colours = _spread(chunk, ("r", "g", "b"), owner, colours)
    words = np.stack([(rotation >> shift) & 1023 for shift in (20, 10, 0)], axis=1)
    return make_splats(
        centres=_spread(chunk, ("x", "y", "z"), owner, _unpack(position, _POSITION_BITS)),
        log_scales=_spread(chunk, ("scale_x", "scale_y", "scale_z"), owner, _unpack(scale, _POSITION_BITS)),
        quaternions=from_smallest_three((words / 1023 - 0.5) * np.sqrt(2.0), rotation >> 30),
        opacities=(colour & 255) / 255,
        colours=colours,
    )


def _unpack(words: Int[Array, " n"], bits: tuple[tuple[int, int], ...]) -> Float[Array, "n k"]:
    """Parts of a word, given as (shift, width), between 0 and 1."""
    return np.stack([(words >> shift & (1 << width) - 1) / ((1 << width) - 1) for shift, width in bits], axis=1)


def _spread(
    chunk: dict[str, Column], names: tuple[str, ...], owner: Int[Array, " n"], share: Float[Array, "n 3"]
) -> Float[Array, "n 3"]:
    """Values between the lowest and the highest of each splat's chunk."""
    low, high = (np.stack([_range(chunk, f"{end}_{name}") for name in names], axis=1) for end in ("min", "max"))
    return low[owner] * (1.0 - share) + high[owner] * share


def _range(table: dict[str, Column], name: str) -> Float[Array, " c"]:
    found = table.get(name)
    if not isinstance(found, np.ndarray):
        raise ValueError(f"there is no column {name!r} in its chunks")
    return found.astype(np.float64)


def _words(table: dict[str, Column], name: str) -> Int[Array, " n"]:
    found = table.get(name)
    if not isinstance(found, np.ndarray) or found.dtype.kind != "u" or found.dtype.itemsize != 4:
        raise ValueError(f"there is no column {name!r} of unsigned 32-bit words in its vertices")
    return found.astype(np.int64)
