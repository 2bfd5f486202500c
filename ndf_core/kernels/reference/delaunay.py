"""Intrinsic Delaunay flips in plain Python, by the law of cosines: what `kernels.delaunay` is compared with."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

Triangle = tuple[tuple[int, float], ...]
"""For each corner its vertex and the length of the edge to the next, turned so that the smallest pair is first."""


def flip_to_delaunay(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], twins: Int[Array, "f 3"]
) -> list[Triangle]:
    """The triangles of the intrinsic Delaunay triangulation, sorted; lengths are rounded to nine digits."""
    corner = [int(v) for v in faces.ravel()]
    twin = [int(h) for h in twins.ravel()]
    length = [
        float(x) for x in np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=2).ravel()
    ]

    def side(h: int, steps: int) -> int:
        return h // 3 * 3 + (h + steps) % 3

    def angle(h: int) -> float:
        """Opposite half-edge h."""
        a, b, c = (length[side(h, i)] for i in range(3))
        return math.acos(max(-1.0, min(1.0, (b * b + c * c - a * a) / (2 * b * c))))

    pending = list(range(len(corner)))
    while pending:
        h = pending.pop()
        g = twin[h]
        if g < 0 or g // 3 == h // 3 or angle(h) + angle(g) <= math.pi + 1e-9:
            continue
        bc, ca, ad, db = side(h, 1), side(h, 2), side(g, 1), side(g, 2)
        wide = angle(bc) + angle(db)
        across = math.sqrt(length[ca] ** 2 + length[ad] ** 2 - 2 * length[ca] * length[ad] * math.cos(wide))
        # (a, b, c), (b, a, d) -> (a, d, c), (d, b, c): ad moves to h, bc to g, and the new edge takes their places.
        moved = {ad: h, bc: g}
        glued = [(moved.get(x, x), moved.get(twin[x], twin[x])) for x in (ca, ad, db, bc)]
        corner[bc], corner[ad] = corner[db], corner[ca]
        length[h], length[g], length[bc], length[ad] = length[ad], length[bc], across, across
        for x, y in [*glued, (bc, ad)]:
            twin[x] = y
            if y >= 0:
                twin[y] = x
        pending += [h, g, ca, db]
    return sorted(canonical(corner[i : i + 3], length[i : i + 3]) for i in range(0, len(corner), 3))


def canonical(corners: list[int], lengths: list[float]) -> Triangle:
    """A triangle that does not depend on which corner comes first."""
    sides = [(vertex, round(length, 9)) for vertex, length in zip(corners, lengths, strict=True)]
    return min(tuple(sides[i:] + sides[:i]) for i in range(3))
