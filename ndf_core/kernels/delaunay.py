"""Intrinsic Delaunay flips on edge lengths: the interface of `src/delaunay.c`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.kernels import _delaunay  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub


class IntrinsicTriangulation(NamedTuple):
    """Triangles that are known by the lengths of their sides, glued along them.

    Loops (both ends of an edge are one vertex) and double edges occur, so an edge is a pair of half-edges and never a
    pair of vertices.
    """

    faces: Int[Array, "f 3"]
    """int32: vertices of the corners."""
    lengths: Float[Array, "f 3"]
    """float64: `lengths[f, i]` is that of half-edge 3 f + i, from corner i to corner i + 1."""
    twins: Int[Array, "f 3"]
    """int32: the half-edge on the other side, -1 at a border."""


def straight_lengths(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3"]:
    """Lengths of the sides of triangles in space, as `IntrinsicTriangulation` has them.

    Raises:
        IndexError: a face names a vertex that does not exist.
    """
    lengths = np.empty(faces.shape)
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    _delaunay.measure(corners, lengths, np.ascontiguousarray(vertices, dtype=np.float64))
    return lengths


def flip_to_delaunay(
    lengths: Float[Array, "f 3"], faces: Int[Array, "f 3"], twins: Int[Array, "f 3"]
) -> tuple[IntrinsicTriangulation, int]:
    """The intrinsic Delaunay triangulation of a mesh whose half-edges are linked, and how many flips led to it.

    Laws: the same on every run; total area, vertices and angle sums stay; opposite angles of every inner edge add
    up to pi at most (cotangents to -1e-9 at least).

    Raises:
        ValueError: `twins` does not link sides in pairs.

    Reference: Fisher, Springborn, Schroeder, Bobenko 2007.
    """
    corners = np.array(faces, dtype=np.int32, order="C")
    sides = np.array(twins, dtype=np.int32, order="C")
    flipped = np.array(lengths, dtype=np.float64, order="C")
    flips = _delaunay.flip(corners, sides, flipped)
    return IntrinsicTriangulation(corners, flipped, sides), flips


def delaunay_share(triangulation: IntrinsicTriangulation, least: float = -1e-6) -> float:
    """Share of the inner edges whose two opposite cotangents add up to `least` at least; 1 where there are none."""
    inner, delaunay = _delaunay.count(triangulation.twins, triangulation.lengths, least)
    return delaunay / inner if inner else 1.0
