"""The header of an MRC2014 / CCP4 map; standard library only, since `sniff` runs it.

Reference: A. Cheng et al., MRC2014: extensions to the MRC format header, J. Struct. Biol. 192 (2015).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

BYTES = 1024
_TYPES = {0: "i1", 1: "i2", 2: "f4", 6: "u2", 12: "f2"}
"""By mode; 3 and 4 are complex, 101 is packed."""


class MrcHeaderError(ValueError):
    """It is an MRC file, and one that cannot be read as a scalar volume."""


@dataclass(frozen=True)
class MrcHeader:
    """Sizes are in columns, rows and sections, as stored; the fastest first."""

    order: Literal["<", ">"]
    dtype: str
    shape: tuple[int, int, int]
    start: tuple[int, int, int]
    """Index of the first column, row and section."""
    axes: tuple[int, int, int]
    """Which of x, y, z columns, rows and sections run along: 0, 1, 2."""
    intervals: tuple[int, int, int]
    """Voxels of the unit cell along x, y, z."""
    cell: tuple[float, float, float]
    """Its sides along x, y, z."""
    angles: tuple[float, float, float]
    """Its angles alpha, beta, gamma, in degrees."""
    origin: tuple[float, float, float]
    offset: int
    """Where the voxels begin."""

    @property
    def data_bytes(self) -> int:
        return math.prod(self.shape) * int(self.dtype[-1])


def read_mrc_header(path: Path) -> MrcHeader | None:
    """The header of an .mrc, .map or .ccp4 file; None where it is none.

    Raises:
        OSError: the file cannot be read.
        MrcHeaderError: it is no volume of real numbers.
    """
    with path.open("rb") as file:
        head = file.read(BYTES)
    if len(head) < BYTES or head[208:211] != b"MAP":
        return None
    order = ">" if head[212] == 0x11 else "<"
    words, floats = struct.unpack_from(f"{order}24i", head), struct.unpack_from(f"{order}6f", head, 40)
    shape, mode, start, intervals = words[0:3], words[3], words[4:7], words[7:10]
    axes, extra = words[16:19], words[23]
    if any(not 0 < side < 1 << 20 for side in shape):
        raise MrcHeaderError(f"its sides are {shape}")
    if mode not in _TYPES:
        raise MrcHeaderError(f"its mode is {mode}: complex or unknown, not real numbers")
    if not 0 <= extra <= 1 << 30:
        raise MrcHeaderError(f"its extended header is {extra} bytes long")
    if sorted(axes) != [1, 2, 3]:
        axes = (1, 2, 3)  # files older than the field have zeros there
    return MrcHeader(
        order,
        _TYPES[mode],
        (shape[0], shape[1], shape[2]),
        (start[0], start[1], start[2]),
        (axes[0] - 1, axes[1] - 1, axes[2] - 1),
        (intervals[0], intervals[1], intervals[2]),
        (floats[0], floats[1], floats[2]),
        (floats[3], floats[4], floats[5]),
        struct.unpack_from(f"{order}3f", head, 196),  # pyright: ignore[reportArgumentType]  # three floats
        BYTES + extra,
    )
