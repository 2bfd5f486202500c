"""Closest points, ray hits and intersecting faces by trying every face: what `TriangleBVH` must agree with."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

Corner = tuple[Fraction, Fraction, Fraction]


def closest(
    points: Float[Array, "n 3"], vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]
) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Closest point of the mesh and its distance, in O(n f) time and memory."""
    a, b, c = (vertices[faces[:, i]][None] for i in range(3))
    q = points[:, None, :]
    normal = np.cross(b - a, c - a)
    area = (normal**2).sum(axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        on_plane = q - ((q - a) * normal).sum(axis=-1, keepdims=True) / area * normal
    turns = [(np.cross(e - s, on_plane - s) * normal).sum(axis=-1) for s, e in ((a, b), (b, c), (c, a))]
    inside = (area[..., 0] > 0) & np.all([turn >= 0 for turn in turns], axis=0)
    candidates = [_closest_on_segment(q, a, b), _closest_on_segment(q, b, c), _closest_on_segment(q, c, a)]
    candidates.append(np.where(inside[..., None], on_plane, candidates[0]))
    every = np.concatenate(candidates, axis=1)
    distances = np.linalg.norm(every - q, axis=-1)
    best = distances.argmin(axis=1)
    rows = np.arange(len(points))
    return every[rows, best], distances[rows, best]


def first_hit(
    origins: Float[Array, "n 3"],
    directions: Float[Array, "n 3"],
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
) -> tuple[Float[Array, " n"], Int[Array, " n"]]:
    """First t >= 0 and its face (inf and -1 for a miss). Reference: Moeller, Trumbore 1997."""
    a, b, c = (vertices[faces[:, i]][None] for i in range(3))
    o, d = origins[:, None, :], directions[:, None, :]
    across = np.cross(d, c - a)
    determinant = ((b - a) * across).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = ((o - a) * across).sum(axis=-1) / determinant
        w = (d * np.cross(o - a, b - a)).sum(axis=-1) / determinant
        t = ((c - a) * np.cross(o - a, b - a)).sum(axis=-1) / determinant
        t = np.where((v >= 0) & (w >= 0) & (v + w <= 1) & (t >= 0), t, np.inf)
    face = t.argmin(axis=1)
    nearest = t[np.arange(len(t)), face]
    return nearest, np.where(np.isfinite(nearest), face, -1).astype(np.int32)


def self_intersections(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Int[Array, "k 2"]:
    """Pairs of faces that properly intersect, decided in exact rational arithmetic."""
    corners = [tuple(Fraction(float(x)) for x in vertex) for vertex in vertices]
    triangles = [[corners[i] for i in face] for face in faces]
    found = [(i, j) for i, j in combinations(range(len(faces)), 2) if _cross(triangles[i], triangles[j])]
    return np.array(found, dtype=np.int32).reshape(-1, 2)


def _closest_on_segment(
    q: Float[Array, "n 1 3"], start: Float[Array, "1 f 3"], end: Float[Array, "1 f 3"]
) -> Float[Array, "n f 3"]:
    along = end - start
    length = (along**2).sum(axis=-1, keepdims=True)
    t = ((q - start) * along).sum(axis=-1, keepdims=True) / np.where(length > 0, length, 1)
    return start + np.clip(t, 0, 1) * along


def _cross(p: Sequence[Corner], q: Sequence[Corner]) -> bool:
    p_normal, q_normal = _normal(p), _normal(q)
    if not any(p_normal) or not any(q_normal):
        return False
    q_heights = [_dot(p_normal, _minus(x, p[0])) for x in q]
    p_heights = [_dot(q_normal, _minus(x, q[0])) for x in p]
    if not any(q_heights):
        return _coplanar_area(p, q, p_normal) > 0
    if any(min(heights) >= 0 or max(heights) <= 0 for heights in (p_heights, q_heights)):
        return False
    line = _vector_product(p_normal, q_normal)
    first, second = _stretch(p, p_heights, line), _stretch(q, q_heights, line)
    return max(first[0], second[0]) < min(first[1], second[1])


def _stretch(triangle: Sequence[Corner], heights: Sequence[Fraction], line: Corner) -> tuple[Fraction, Fraction]:
    """Where the triangle meets the plane that the heights are over, measured along `line`."""
    places = [_dot(line, x) for x, height in zip(triangle, heights, strict=True) if height == 0]
    for i, j in combinations(range(3), 2):
        if heights[i] * heights[j] < 0:
            share = heights[i] / (heights[i] - heights[j])
            one, two = _dot(line, triangle[i]), _dot(line, triangle[j])
            places.append(one + share * (two - one))
    return min(places), max(places)


def _coplanar_area(p: Sequence[Corner], q: Sequence[Corner], normal: Corner) -> Fraction:
    """Twice the area of the common part, in the projection along the normal's largest axis (Sutherland, Hodgman)."""
    z = max(range(3), key=lambda k: abs(normal[k]))
    x, y = (z + 1) % 3, (z + 2) % 3
    flat = [[(corner[x], corner[y]) for corner in triangle] for triangle in (p, q)]
    clip, part = (triangle if _area(triangle) > 0 else triangle[::-1] for triangle in flat)
    for (ax, ay), (bx, by) in zip(clip, clip[1:] + clip[:1], strict=True):
        sides = [(bx - ax) * (v - ay) - (by - ay) * (u - ax) for u, v in part]
        kept: list[tuple[Fraction, Fraction]] = []
        for i, (u, v) in enumerate(part):
            (u2, v2), side, following = part[(i + 1) % len(part)], sides[i], sides[(i + 1) % len(part)]
            if side >= 0:
                kept.append((u, v))
            if side * following < 0:
                share = side / (side - following)
                kept.append((u + share * (u2 - u), v + share * (v2 - v)))
        part = kept
        if not part:
            return Fraction(0)
    return abs(_area(part))


def _area(polygon: Sequence[tuple[Fraction, Fraction]]) -> Fraction:
    following = [*polygon[1:], *polygon[:1]]
    return sum((u * v2 - v * u2 for (u, v), (u2, v2) in zip(polygon, following, strict=True)), Fraction(0))


def _minus(a: Corner, b: Corner) -> Corner:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Corner, b: Corner) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _vector_product(a: Corner, b: Corner) -> Corner:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _normal(triangle: Sequence[Corner]) -> Corner:
    return _vector_product(_minus(triangle[1], triangle[0]), _minus(triangle[2], triangle[0]))
