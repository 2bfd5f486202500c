"""Whether a file holds points, and points with normals; standard library only, since `sniff` runs it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ndf_core.readers.ply_header import PlyHeaderError, read_ply_header

Format = Literal["ply", "pcd", "text"]

_WINDOW = 64 << 10
_SPLATS = ("f_dc_0", "scale_0", "rot_0", "packed_position")
_PCD = re.compile(rb"(?:\s*#[^\n]*\n)*\s*VERSION\s", re.IGNORECASE)
_COLUMNS = range(3, 13)


@dataclass(frozen=True)
class Content:
    """What the first look shows."""

    format: Format
    normals: bool


def look(path: Path) -> Content | None:
    """Recognise a file of points by its content; None where it is none.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_WINDOW)
    if re.match(rb"ply\r?\n", head):
        return _ply(head)
    if _PCD.match(head):
        return Content("pcd", b"normal_x" in head.partition(b"DATA")[0])
    return _text(head)


def _ply(head: bytes) -> Content | None:
    try:
        elements = read_ply_header(head).elements
    except PlyHeaderError:
        return None
    tables = {element.name: element for element in elements}
    if any(name in tables and tables[name].count for name in ("face", "tristrips")) or "vertex" not in tables:
        return None
    names = {item.name for item in tables["vertex"].properties}
    if not {"x", "y", "z"} <= names or names & set(_SPLATS):
        return None
    return Content("ply", {"nx", "ny", "nz"} <= names)


def _text(head: bytes) -> Content | None:
    """Lines of numbers, all alike but for the first, which may be their count."""
    if b"\0" in head:
        return None
    lines = head.decode("latin-1").splitlines()
    if len(head) == _WINDOW:
        lines = lines[:-1]
    rows = [words for words in map(split_line, lines) if words]
    try:
        numbers = [[float(word) for word in words] for words in rows]
    except ValueError:
        return None
    count = numbers[0][0] if numbers and len(numbers[0]) == 1 else None
    numbers = numbers[1:] if count is not None else numbers
    widths = {len(row) for row in numbers}
    if len(widths) != 1 or not widths <= set(_COLUMNS):
        return None
    if unit_columns(numbers) is not None:
        return Content("text", True)
    # Points first, then as many normals: only the size of the file shows it, which is looked at when it is read.
    return Content("text", False)


def split_line(line: str) -> list[str]:
    """Words of a line; commas and semicolons count as spaces, lines that begin with # or // as empty."""
    line = line.strip()
    return [] if line.startswith(("#", "//")) else re.split(r"[\s,;]+", line.strip(",; \t")) if line else []


def unit_columns(rows: list[list[float]]) -> int | None:
    """The first of three columns that hold unit vectors, in nine rows of ten; None where there are none.

    They stand after the coordinates, or after coordinates and colours.
    """
    if not rows:
        return None
    for first in (3, len(rows[0]) - 3):
        if first < 3:
            continue
        squares = [sum(x * x for x in row[first : first + 3]) for row in rows]
        unit = sum(0.9 < square < 1.1 for square in squares)
        if unit >= 0.9 * len(rows) and any(x < 0 for row in rows for x in row[first : first + 3]):
            return first
    return None
