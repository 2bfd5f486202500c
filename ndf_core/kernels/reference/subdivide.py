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


def long_edges(
    corners: Int[Array, "f 3"], mapped: Float[Array, "n 3"], base: Float[Array, "n 3"], limit: float
) -> dict[Edge, int]:
    """Number of the midpoint of every edge to be split, numbered as they are met.

    Edges longer than `limit`; and in faces with an edge to be split, until nothing changes, the longest edge on the
    base mesh where the altitude over it is less than 1/4 of its length.
    """
    edges = [edges_of(face) for face in corners]
    chosen = {(a, b) for face in edges for a, b in face if np.linalg.norm(mapped[a] - mapped[b]) > limit}
    along: list[Edge | None] = []
    for face, sides in zip(corners, edges, strict=True):
        lengths = [float(np.linalg.norm(base[a] - base[b])) for a, b in sides]
        area = np.linalg.norm(np.cross(base[face[1]] - base[face[0]], base[face[2]] - base[face[0]]))
        along.append(sides[int(np.argmax(lengths))] if area < max(lengths) ** 2 / 4 else None)
    while True:
        added = {long for long, sides in zip(along, edges, strict=True) if long and not chosen.isdisjoint(sides)}
        if added <= chosen:
            break
        chosen |= added
    midpoints: dict[Edge, int] = {}
    for edge in (edge for face in edges for edge in face):
        if edge in chosen and edge not in midpoints:
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
