"""Wavefront OBJ: the lines `v` and `f`. Texture, normals, groups and materials are not read."""

from __future__ import annotations

import re

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.readers.numbers import parse_numbers
from ndf_core.readers.polygons import RawMesh, fans

_VERTEX = re.compile(rb"^[ \t]*v[ \t]([^\r\n#]*)", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*f[ \t]([^\r\n#]*)", re.MULTILINE)


def read_obj(data: bytes) -> RawMesh:
    """Read vertices and faces.

    Raises:
        ValueError: a vertex or a face cannot be read.
    """
    data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    vertices = _vertices(_VERTEX.findall(data))
    corners, sizes = _corners(data, len(vertices))
    faces, notes = fans(corners, sizes)
    return RawMesh(vertices, faces, notes)


def _vertices(lines: list[bytes]) -> Float[Array, "v 3"]:
    widths = {len(line.split()) for line in lines}
    if not widths:
        return np.zeros((0, 3))
    if min(widths) < 3:
        row = next(i for i, line in enumerate(lines) if len(line.split()) < 3)
        raise ValueError(f"vertex {row + 1} has fewer than three coordinates")
    if len(widths) > 1:  # colours after some of the vertices
        lines = [b" ".join(line.split()[:3]) for line in lines]
        widths = {3}
    return parse_numbers(b" ".join(lines)).reshape(len(lines), widths.pop())[:, :3]


def _corners(data: bytes, vertex_count: int) -> tuple[Int[Array, " n"], Int[Array, " p"]]:
    """Vertex of each corner, counted from 0, and the number of corners of each face."""
    lines = _FACE.findall(data)
    split = [line.split() for line in lines]
    sizes = np.array([len(words) for words in split], dtype=np.int64)
    # A corner is vertex/texture/normal, the latter two optional.
    words = [word.partition(b"/")[0] for face in split for word in face]
    try:
        # Through Python's integers: a number beyond int64 is an error here, and not a wrapped one.
        corners = np.array([int(word) for word in words], dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise ValueError("a face names something that is no vertex number") from error
    if (corners == 0).any():
        raise ValueError("a face names vertex 0; they are counted from 1")
    if (corners < 0).any():
        # Counted back from the last vertex before the face, so the order of the lines matters.
        starts = np.array([match.start() for match in _VERTEX.finditer(data)])
        before = np.searchsorted(starts, [match.start() for match in _FACE.finditer(data)])
        corners = np.where(corners < 0, corners + np.repeat(before, sizes) + 1, corners)
        if (corners <= 0).any():
            raise ValueError("a face counts back beyond the first vertex")
    return corners - 1, sizes
