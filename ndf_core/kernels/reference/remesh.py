"""Straight lines on a triangle mesh, followed in space: what the edges of `kernels.remesh` are compared with.

The direction is a vector of space. Where the line crosses an edge, the vector is turned about it into the next face's
plane; nothing is laid out in the plane.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

ON_EDGE = 1e-9


def in_space(corners: Float[Array, "3 3"], vector: Float[Array, "2"]) -> Float[Array, "3"]:
    """A vector of a face's plane, whose x axis is the face's first edge."""
    x = corners[1] - corners[0]
    x = x / np.linalg.norm(x)
    normal = np.cross(x, corners[2] - corners[0])
    return vector[0] * x + vector[1] * np.cross(normal / np.linalg.norm(normal), x)


def end_of_line(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    twins: Int[Array, "f 3"],
    face: int,
    start: Float[Array, "3"],
    vector: Float[Array, "3"],
) -> Float[Array, "3"]:
    """Where the straight line from `start`, in the closure of `face`, along `vector`, in its plane, ends."""
    point, rest = start, vector
    entered = -1
    while True:
        corners = vertices[faces[face]]
        here, there = weights(corners, point), weights(corners, point + rest)
        # Shares of the rest at which it crosses the line through each edge, which is opposite a corner.
        crossed = [
            (max(here[k], 0.0) / (max(here[k], 0.0) - there[k]), (k + 1) % 3)
            for k in range(3)
            if there[k] < -ON_EDGE and (k + 1) % 3 != entered
        ]
        if not crossed:
            return point + rest
        share, edge = min(crossed)
        point, rest = point + share * rest, (1 - share) * rest
        a, b = corners[edge], corners[(edge + 1) % 3]
        along = (b - a) / np.linalg.norm(b - a)
        twin = int(twins[face, edge])
        assert twin >= 0, "the line leaves the mesh"
        face, entered = twin // 3, twin % 3
        apex = vertices[faces[face, (entered + 2) % 3]]
        inward = (apex - a) - np.dot(apex - a, along) * along
        ahead = np.dot(rest, along)
        sideways = np.sqrt(max(np.dot(rest, rest) - ahead**2, 0.0))
        rest = ahead * along + sideways * inward / np.linalg.norm(inward)


def weights(corners: Float[Array, "3 3"], point: Float[Array, "3"]) -> Float[Array, "3"]:
    """Barycentric weights of a point in a face's plane."""
    edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=1)
    second, third = np.linalg.lstsq(edges, point - corners[0], rcond=None)[0]
    return np.array([1 - second - third, second, third])
