"""Conforming subdivision in plain numpy and Python, face by face: what `kernels.subdivide` is compared with.

Faces are plain (f, 3) corners with their homes; edges are looked up by their two vertices, not by twins.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

Edge = tuple[int, int]


def edges_of(face: Int[Array, "3"]) -> list[Edge]:
    """The three edges, each as a sorted pair."""
    a, b, c = (int(vertex) for vertex in face)
    return [(min(pair), max(pair)) for pair in pairwise((a, b, c, a))]


def long_edges(corners: Int[Array, "f 3"], mapped: Float[Array, "n 3"], limit: float) -> dict[Edge, int]:
    """Number of the midpoint of every edge longer than `limit`, numbered as they are met."""
    midpoints: dict[Edge, int] = {}
    for face in corners:
        for edge in edges_of(face):
            if edge not in midpoints and np.linalg.norm(mapped[edge[0]] - mapped[edge[1]]) > limit:
                midpoints[edge] = len(mapped) + len(midpoints)
    return midpoints


def split_face(face: Int[Array, "3"], midpoints: dict[Edge, int], mapped: Float[Array, "n 3"]) -> list[list[int]]:
    """The children of one face, counter-clockwise; of two diagonals the shorter one."""
    corners = [int(vertex) for vertex in face]
    middles = [midpoints.get(edge) for edge in edges_of(face)]
    # Cut off the corners between two split edges, and triangulate what is left: a polygon with at most four corners,
    # or the inner triangle when all three corners are gone.
    children, rest = list[list[int]](), list[int]()
    for i in range(3):
        before, after = middles[i - 1], middles[i]
        if before is not None and after is not None:
            children.append([before, corners[i], after])
        else:
            rest.append(corners[i])
        if after is not None:
            rest.append(after)
    if len(rest) == 3:
        return [*children, rest]
    a, b, c, d = rest
    if np.linalg.norm(mapped[a] - mapped[c]) <= np.linalg.norm(mapped[b] - mapped[d]):
        return [*children, [a, b, c], [a, c, d]]
    return [*children, [a, b, d], [b, c, d]]


def weights_in(base_faces: Int[Array, "b 3"], face: int, own: int, weights: Float[Array, "3"]) -> Float[Array, "3"]:
    """Weights in base face `face` of a point that is given in base face `own` and lies in both."""
    if face == own:
        return weights
    by_vertex = {int(vertex): weight for vertex, weight in zip(base_faces[own], weights, strict=True)}
    return np.array([by_vertex.get(int(vertex), 0.0) for vertex in base_faces[face]])
