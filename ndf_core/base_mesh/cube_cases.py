"""The 256 cases of marching cubes, worked out from one rule instead of copied from a table.

Corner c of a cell has the offsets (c & 1, c >> 1 & 1, c >> 2 & 1); a case is the set of its corners inside. On each
face of the cell, every run of inside corners along the face's outline is cut off by one segment. Two cells that share
a face see the same corners there and draw the same segments, so the surface has no gaps. The segments close up to
polygons, which are cut into triangles along diagonals that do not lie in a face of the cell: a diagonal in a face
could meet one of the next cell, and their common edge would have four triangles. Hence the surface is manifold in
every case.

Reference:
    Lorensen and Cline 1987; Montani, Scateni and Scopigno 1994 (the rule that keeps inside corners apart).
"""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
from jaxtyping import Int
from numpy import ndarray as Array

EDGES: tuple[tuple[int, int], ...] = tuple(
    (corner, corner | 1 << axis) for axis in range(3) for corner in range(8) if not corner >> axis & 1
)
"""The twelve edges as pairs of corners; edge e runs along axis e // 4, from its lower corner."""
_EDGE_OF = {pair: index for index, pair in enumerate(EDGES)} | {(b, a): index for index, (a, b) in enumerate(EDGES)}


@cache
def case_triangles() -> tuple[Int[Array, "256 t 3"], Int[Array, " 256"]]:
    """Triangles of each case as triples of edges, padded with -1, and their number.

    Seen from outside (from the corners that are not in the case) the triangles run counter-clockwise.
    """
    cases = [[triangle for loop in _polygons(case) for triangle in _triangulate(loop)] for case in range(256)]
    counts = np.array([len(triangles) for triangles in cases])
    table = np.full((256, int(counts.max()), 3), -1, dtype=np.int64)
    for case, triangles in enumerate(cases):
        table[case, : len(triangles)] = np.array(triangles).reshape(-1, 3)
    return table, counts


def _outlines() -> list[tuple[int, int, int, int]]:
    """The corners of each of the six faces, counter-clockwise seen from outside the cell."""
    faces: list[tuple[int, int, int, int]] = []
    for axis, side in product(range(3), range(2)):
        u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        base = side << axis
        first, last = (u, v) if side else (v, u)
        faces.append((base, base | first, base | u | v, base | last))
    return faces


def _polygons(case: int) -> list[list[int]]:
    """Closed polygons of a case, as lists of the edges that they cross."""
    following: dict[int, int] = {}
    for outline in _outlines():
        inside = [bool(case >> corner & 1) for corner in outline]
        for start in range(4):
            if inside[start] or not inside[(start + 1) % 4]:
                continue
            # A run of inside corners begins here; find where the outline leaves it.
            end = next(start + k for k in range(1, 5) if inside[(start + k) % 4] and not inside[(start + k + 1) % 4])
            enters, leaves = (_EDGE_OF[outline[i % 4], outline[(i + 1) % 4]] for i in (start, end))
            following[enters] = leaves
    loops: list[list[int]] = []
    while following:
        first = edge = min(following)
        loop: list[int] = []
        while edge != first or not loop:
            loop.append(edge)
            edge = following.pop(edge)
        loops.append(loop)
    return loops


def _triangulate(loop: list[int]) -> list[tuple[int, int, int]]:
    """Triangles that fill a polygon without a diagonal in a face of the cell."""
    found = _fill(tuple(loop))
    if found is None:
        raise AssertionError(f"polygon {loop} cannot be cut without a diagonal in a face")
    return found


def _fill(loop: tuple[int, ...]) -> list[tuple[int, int, int]] | None:
    if len(loop) == 3:
        return [(loop[0], loop[1], loop[2])]
    last = len(loop) - 1
    for middle in range(1, last):
        parts: list[tuple[int, int, int]] | None = [(loop[0], loop[middle], loop[last])]
        for part in (loop[: middle + 1], loop[middle:]):
            if len(part) < 3 or parts is None:
                continue
            filled = None if _in_one_face(part[0], part[-1]) else _fill(part)
            parts = None if filled is None else parts + filled
        if parts is not None:
            return parts
    return None


def _in_one_face(one: int, other: int) -> bool:
    corners = {*EDGES[one], *EDGES[other]}
    return any(corners <= set(outline) for outline in _outlines())
