"""Shortest paths along a surface as polylines (potpourri3d's edge flips)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.processing.insertion import insert_points
from ndf_core.processing.operators import Operators


@dataclass(frozen=True)
class GeodesicPath:
    """A locally shortest path."""

    points: Float[Array, "n 3"]
    """Where it bends in space, from start to end; it runs along the triangles in between."""
    length: float
    """The mesh's units; infinity, with no points, where the ends are on different components."""


def geodesic_path(
    operators: Operators, start: Sequence[float] | Float[Array, "3"], end: Sequence[float] | Float[Array, "3"]
) -> GeodesicPath:
    """The path from the point of the mesh closest to `start` to the one closest to `end`.

    The shortest way along edges is straightened until it is a geodesic of the triangles: shorter than all its
    neighbours, which need not be the shortest of all where there are several ways around.

    Raises:
        InputError: a point is not finite, or the mesh is no manifold.

    Reference: Sharp and Crane 2020, You Can Find Geodesic Paths in Triangle Meshes by Just Flipping Edges.
    """
    from potpourri3d import EdgeFlipGeodesicSolver

    ends = operators.closest(np.array([start, end], dtype=np.float64))
    part = operators.components[operators.faces[ends.faces, 0]]
    if part[0] != part[1]:
        return GeodesicPath(np.zeros((0, 3)), float("inf"))
    vertices, faces, (first, last) = insert_points(operators.vertices, operators.faces, ends)
    if first == last:
        return GeodesicPath(ends.positions, 0.0)
    try:
        points = EdgeFlipGeodesicSolver(vertices, faces).find_geodesic_path(int(first), int(last))
    except (RuntimeError, ValueError) as error:
        raise InputError(f"no path can be traced: {error}; the mesh must be a manifold") from error
    points = np.asarray(points, dtype=np.float64)
    return GeodesicPath(points, float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
