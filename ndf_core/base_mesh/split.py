"""Splitting of long edges, so that decimation finds material for even triangles. The surface stays the same."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array


def even_edge_length(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], face_count: int) -> float:
    """Edge length of equilateral triangles of which `face_count` cover the mesh's area; units of the vertices."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    return float(np.sqrt(4.0 / np.sqrt(3.0) * area / face_count))


def split_long_edges(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], max_length: float, max_faces: int
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"]]:
    """Halve edges longer than `max_length` at their midpoints, conformingly, until none is left.

    Laws: every point of the surface stays where it is up to rounding, the topology and the orientation stay, the
    input's vertices stay first and keep their order; the result depends on the arguments alone.

    Args:
        max_length: In the units of the vertices.
        max_faces: Stop before a round that would give more faces than this; edges above `max_length` may be left.
    """
    faces = faces.astype(np.int64)
    while True:
        start, end = faces, faces[:, [1, 2, 0]]
        long = ((vertices[start] - vertices[end]) ** 2).sum(axis=2) > max_length**2
        if not long.any() or len(faces) + int(long.sum()) > max_faces:
            return vertices, faces.astype(np.int32)
        low, high = np.minimum(start, end)[long], np.maximum(start, end)[long]
        _, first, inverse = np.unique(low * len(vertices) + high, return_index=True, return_inverse=True)
        middle = np.full(faces.shape, -1, dtype=np.int64)
        middle[long] = inverse + len(vertices)
        vertices = np.concatenate([vertices, 0.5 * (vertices[low[first]] + vertices[high[first]])])
        faces = _split(vertices, faces, middle)


def _split(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], middle: Int[Array, "f 3"]) -> Int[Array, "g 3"]:
    """Replace each face by 2, 3 or 4 according to how many of its edges have a middle vertex (-1: none)."""
    has = middle >= 0
    count = has.sum(axis=1)
    # Rotate each face so that its first edge is split and, of two split ones, they are the first and the second.
    turn = np.select([count == 1, count == 2], [has.argmax(axis=1), (has.argmin(axis=1) + 1) % 3], 0)
    columns = (np.arange(3) + turn[:, None]) % 3
    (a, b, c) = np.take_along_axis(faces, columns, axis=1).T
    (ab, bc, ca) = np.take_along_axis(middle, columns, axis=1).T
    one, two, three = count == 1, count == 2, count == 3
    # The quadrilateral (a, ab, bc, c) is cut along its shorter diagonal.
    short = two & (_squared(vertices, a, bc) <= _squared(vertices, ab, c))
    other = two & ~short
    pieces = [
        (faces[count == 0],),
        (_stack(one, a, ab, c), _stack(one, ab, b, c)),
        (_stack(two, ab, b, bc),),
        (_stack(short, a, ab, bc), _stack(short, a, bc, c)),
        (_stack(other, a, ab, c), _stack(other, ab, bc, c)),
        (_stack(three, a, ab, ca), _stack(three, ab, b, bc), _stack(three, ca, bc, c), _stack(three, ab, bc, ca)),
    ]
    return np.concatenate([piece for group in pieces for piece in group])


def _stack(rows: Bool[Array, " f"], *columns: Int[Array, " f"]) -> Int[Array, "g 3"]:
    return np.stack([column[rows] for column in columns], axis=1)


def _squared(vertices: Float[Array, "v 3"], i: Int[Array, " f"], j: Int[Array, " f"]) -> Float[Array, " f"]:
    return ((vertices[i] - vertices[j]) ** 2).sum(axis=1)
