"""PLY: the triangles of its polygons and triangle strips."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from numpy import ndarray as Array

from ndf_core.readers.numbers import as_indices
from ndf_core.readers.ply_tables import Column, read_ply_tables
from ndf_core.readers.polygons import RawMesh, fans, strip_triangles

_LISTS = ("vertex_indices", "vertex_index")


def read_ply(data: bytes) -> RawMesh:
    """Read vertices and faces.

    Raises:
        ValueError: the file is not valid PLY, holds less than its header says, or has no faces.
    """
    tables = read_ply_tables(data)
    faces, notes = triangles_of(tables)
    if not len(faces):
        raise ValueError("there are no faces in it; it may be a point cloud or splats")
    vertex = tables.get("vertex", {})
    if not all(isinstance(vertex.get(axis), np.ndarray) for axis in "xyz"):
        raise ValueError("there are no vertices with x, y and z")
    vertices = np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    return RawMesh(vertices, faces, notes)


def triangles_of(tables: dict[str, dict[str, Column]]) -> tuple[Int[Array, "f 3"], tuple[str, ...]]:
    """The triangles of all polygons and strips, and notes.

    Raises:
        ValueError: a polygon has fewer than three corners, or an index is no whole number.
    """
    corners, sizes = _lists(tables, "face")
    strips, strip_sizes = _lists(tables, "tristrips")
    faces, notes = fans(corners, sizes)
    pieces = (
        [strip_triangles(strip) for strip in np.split(strips, np.cumsum(strip_sizes)[:-1])] if len(strips) else []
    )
    return np.concatenate([faces, *pieces]), notes


def _lists(tables: dict[str, dict[str, Column]], name: str) -> tuple[Int[Array, " n"], Int[Array, " p"]]:
    """Items and lengths of the index lists of a table."""
    for column in _LISTS:
        found = tables.get(name, {}).get(column)
        if isinstance(found, tuple):
            sizes, items = found
            return as_indices(items.astype(np.float64)), as_indices(sizes.astype(np.float64))
    return np.zeros(0, np.int64), np.zeros(0, np.int64)
