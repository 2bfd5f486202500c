"""Conforming subdivision of a mesh that lies on a base mesh: the interface of `src/subdivide.c`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels import _subdivide  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub


class Triangulation(NamedTuple):
    """Faces of a mesh on a base mesh, each inside one base face. int32, contiguous."""

    corners: Int[Array, "f 3"]
    twins: Int[Array, "f 3"]
    """Half-edge 3 f + i runs from corner i to corner i + 1 of face f. Its twin is the other side, -1 at a border."""
    home: Int[Array, " f"]
    """The base face that each face lies in."""


class BasePoints(NamedTuple):
    """Points of a base mesh. Weights are dyadic where they come from `place_midpoints`, hence exact."""

    base_faces: Int[Array, "b 3"]
    """int32: corners of the base faces."""
    faces: Int[Array, " n"]
    """int32: the base face of each point; for a point on a base edge, either of its two."""
    barycentric: Float[Array, "n 3"]
    """float64."""


def mark_long_edges(
    mesh: Triangulation, mapped: Float[Array, "n 3"], base: Float[Array, "n 3"], limit: float
) -> tuple[Int[Array, "f 3"], int]:
    """Number the midpoints of the edges to be split, from the number of vertices on.

    These are the edges longer than `limit` in `mapped`; and in faces with an edge to be split that are thinner than
    1/4 on the base mesh (`base`: the vertices there), the edge along them. Law: where the map is Lipschitz, splitting
    ends.

    Returns:
        For each half-edge the number of its edge's midpoint or -1, and how many there are.
    """
    midpoint = np.empty_like(mesh.corners)
    return midpoint, _subdivide.mark(midpoint, mesh.corners, mesh.twins, mapped, base, limit)


def place_midpoints(
    mesh: Triangulation, midpoint: Int[Array, "f 3"], count: int, points: BasePoints
) -> tuple[Int[Array, " m"], Float[Array, "m 3"]]:
    """Base faces and barycentric weights of the `count` midpoints, in order of their numbers."""
    faces, weights = np.empty(count, np.int32), np.empty((count, 3))
    _subdivide.place(faces, weights, midpoint, mesh.corners, mesh.twins, mesh.home, *points)
    return faces, weights


def split_faces(mesh: Triangulation, midpoint: Int[Array, "f 3"], mapped: Float[Array, "n 3"]) -> Triangulation:
    """Split every face at its edges' midpoints, into two, three or four; `mapped` includes the midpoints.

    Laws: conforming, so closed, manifold and oriented meshes stay so, with the same Euler characteristic; where two
    edges are split, the shorter diagonal of the rest is taken.
    """
    chosen = np.empty(len(mesh.corners), np.uint8)
    count = _subdivide.choose(chosen, midpoint, mesh.corners, mapped)
    finer = Triangulation(np.empty((count, 3), np.int32), np.empty((count, 3), np.int32), np.empty(count, np.int32))
    _subdivide.split(*finer, chosen, midpoint, *mesh)
    return finer


def flip_edges(
    mesh: Triangulation, mapped: Float[Array, "n 3"], points: BasePoints, limit: float, sweeps: int
) -> int:
    """Flip edges in place that are not Delaunay in `mapped`, where base face and shape allow it; the number of flips.

    Laws: base edges stay; every face keeps its home and its orientation there, so the map stays a bijection; no edge
    longer than `limit` appears, unless it replaces a longer one.
    """
    return _subdivide.flip(*mesh, mapped, *points, limit, sweeps)
