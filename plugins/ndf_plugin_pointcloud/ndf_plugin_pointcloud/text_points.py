"""Points as lines of numbers: .xyz, .pts, .pwn, and the same with commas."""

from __future__ import annotations

import re

from numpy import ndarray as Array

from ndf_core.readers.numbers import parse_numbers
from ndf_plugin_pointcloud.detect import split_line, unit_columns

_COMMENT = re.compile(rb"^[ \t]*(?:#|//)[^\r\n]*", re.MULTILINE)
_SEPARATORS = bytes.maketrans(b",;", b"  ")
_SAMPLE = 200
"""Rows that are looked at to tell normals from colours."""


def read_text_points(data: bytes) -> tuple[Array, Array | None]:
    """Points and, where there are unit vectors beside them, normals.

    A first line with one number announces how many points follow. If twice as many rows of three do, the second half
    are normals (the older .pwn). Columns that are neither (colours, intensities) are left out.

    Raises:
        ValueError: something else than numbers is in it, rows differ in length, or there are fewer than announced.
    """
    text = _COMMENT.sub(b"", data).translate(_SEPARATORS)
    lines = text.split(b"\n", 1)
    while len(lines) == 2 and not lines[0].strip():
        lines = lines[1].split(b"\n", 1)
    count = None
    words = split_line(lines[0].decode("latin-1"))
    if len(words) == 1 and len(lines) == 2:
        announced = float(parse_numbers(lines[0])[0])
        if not (0 <= announced < 1e15 and announced == int(announced)):
            raise ValueError(f"the first line announces {words[0]:.40} points")
        count, text = int(announced), lines[1]
    body = [line for line in text.splitlines() if line.strip()]
    if not body:
        raise ValueError("there are no points in it")
    width = len(body[0].split())
    if width < 3:
        raise ValueError(f"its rows have {width} numbers; three are needed")
    if any(len(line.split()) != width for line in body):
        row = next(i for i, line in enumerate(body) if len(line.split()) != width)
        raise ValueError(f"row {row + 1} has {len(body[row].split())} numbers, others have {width}; is it cut off?")
    rows = parse_numbers(text).reshape(len(body), width)
    if count is not None and len(rows) < count:
        raise ValueError(f"it announces {count:,} points but has {len(rows):,}; it is cut off")
    if count and width == 3 and len(rows) == 2 * count:
        return rows[:count], rows[count:]
    rows = rows if count is None else rows[:count]
    first = unit_columns(rows[:: max(1, len(rows) // _SAMPLE)].tolist())
    return rows[:, :3], None if first is None else rows[:, first : first + 3]
