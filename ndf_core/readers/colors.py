"""The colours that mesh and point files keep at their vertices: .ply, .obj, .off, .glb."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.readers.detect import look
from ndf_core.readers.glb import read_glb_colors
from ndf_core.readers.numbers import parse_numbers
from ndf_core.readers.ply_tables import read_ply_tables

_OBJ_VERTEX = re.compile(rb"^[ \t]*v[ \t]([^\r\n#]*)", re.MULTILINE)
_PLY_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))


class VertexColors(NamedTuple):
    """Points with colours."""

    points: Float[Array, "n 3"]
    """float64, the file's coordinates."""
    colors: Float[Array, "n 3"]
    """Red, green, blue in [0, 1], as the file has them."""


def read_vertex_colors(source: str | Path | object) -> VertexColors | None:
    """The coloured vertices of a file; None where it has none, is none, or is in a format whose colours are not read.

    Vertices without finite coordinates are left out.

    Raises:
        InputError: the file cannot be read.
    """
    if not isinstance(source, str | Path):
        return None
    path = Path(source)
    try:
        if not path.is_file():
            return None
        kind = look(path).format or path.suffix.lower().lstrip(".")
        reader = {"ply": _ply, "obj": _obj, "off": _off, "glb": _glb}.get(kind)
        found = reader(path.read_bytes()) if reader else None
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(f"{path}: its colours cannot be read: {error}") from error
    if found is None:
        return None
    finite = np.isfinite(found.points).all(axis=1) & np.isfinite(found.colors).all(axis=1)
    if not finite.any():
        return None
    return VertexColors(found.points[finite], np.clip(found.colors[finite], 0.0, 1.0))


def _ply(data: bytes) -> VertexColors | None:
    vertex = read_ply_tables(data).get("vertex", {})
    for names in _PLY_NAMES:
        if all(isinstance(vertex.get(name), np.ndarray) for name in ("x", "y", "z", *names)):
            points = np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1)
            return VertexColors(points, np.stack([_share(np.asarray(vertex[name])) for name in names], axis=1))
    return None


def _share(values: Array) -> Float[Array, " n"]:
    """Whole numbers as shares of their type's largest."""
    return values / float(np.iinfo(values.dtype).max) if values.dtype.kind in "iu" else values.astype(np.float64)


def _obj(data: bytes) -> VertexColors | None:
    lines = [line.split() for line in _OBJ_VERTEX.findall(data)]
    rows = [line[:6] for line in lines if len(line) in (6, 7)]
    if not rows or len(rows) < len(lines):
        return None
    numbers = parse_numbers(b" ".join(word for row in rows for word in row)).reshape(-1, 6)
    return VertexColors(numbers[:, :3], numbers[:, 3:])


def _off(data: bytes) -> VertexColors | None:
    text = re.sub(rb"#[^\r\n]*", b"", data)
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines or not lines[0].strip().startswith(b"COFF"):
        return None
    counts = lines[1] if lines[0].strip() == b"COFF" else lines[0].strip()[4:]
    first = 2 if lines[0].strip() == b"COFF" else 1
    count = int(counts.split()[0])
    rows = [line.split() for line in lines[first : first + count]]
    if len(rows) < count or any(len(row) < 6 for row in rows):
        raise ValueError("a vertex has no colour")
    numbers = parse_numbers(b" ".join(word for row in rows for word in row[:6])).reshape(-1, 6)
    whole = not any(b"." in word for row in rows for word in row[3:6])
    return VertexColors(numbers[:, :3], numbers[:, 3:] / (255.0 if whole else 1.0))


def _glb(data: bytes) -> VertexColors | None:
    found = read_glb_colors(data)
    return None if found is None else VertexColors(*found)
