"""OFF, with colours, normals and texture coordinates skipped."""

from __future__ import annotations

import re

import numpy as np

from ndf_core.readers.numbers import as_indices, parse_numbers
from ndf_core.readers.polygons import RawMesh, fans

_COMMENT = re.compile(rb"#[^\r\n]*")
_KEYWORD = re.compile(rb"\s*(?:ST)?C?N?OFF\b")


def read_off(data: bytes) -> RawMesh:
    """Read a text OFF file.

    Raises:
        ValueError: it holds less than it announces, or something that is no number.
    """
    if b"\0" in data[:4096] or b"BINARY" in data[:64]:
        raise ValueError("binary OFF is not read; convert it to text")
    text = _COMMENT.sub(b"", data)
    keyword = _KEYWORD.match(text)
    if keyword is None:
        raise ValueError("it does not begin with OFF")
    lines = [line for line in text[keyword.end() :].splitlines() if line.strip()]
    counts = as_indices(parse_numbers(lines[0])) if lines else np.zeros(0, np.int64)
    if len(counts) < 2 or (counts[:2] < 0).any():
        raise ValueError("the numbers of vertices and faces are missing")
    vertices, faces = int(counts[0]), int(counts[1])
    if vertices + faces > len(lines) - 1:
        raise ValueError(
            f"it announces {vertices:,} vertices and {faces:,} faces, but has {len(lines) - 1:,} lines for them"
        )
    points = [line.split()[:3] for line in lines[1 : 1 + vertices]]
    if any(len(point) != 3 for point in points):
        raise ValueError("a vertex has fewer than three coordinates")
    rows = [line.split() for line in lines[1 + vertices : 1 + vertices + faces]]
    sizes = as_indices(parse_numbers(b" ".join(row[0] for row in rows)))
    if (sizes < 0).any() or any(len(row) <= size for row, size in zip(rows, sizes.tolist(), strict=True)):
        raise ValueError("a face has fewer corners than it announces")
    corners = as_indices(
        parse_numbers(b" ".join(word for row, n in zip(rows, sizes.tolist(), strict=True) for word in row[1 : n + 1]))
    )
    triangles, notes = fans(corners, sizes)
    return RawMesh(parse_numbers(b" ".join(b" ".join(point) for point in points)).reshape(-1, 3), triangles, notes)
