"""Quadric edge collapse that keeps topology: the interface of `src/decimate.c`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels import _decimate  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub


class Decimated(NamedTuple):
    """A decimated mesh; unpacks as ``vertices, faces, cluster``."""

    vertices: Float[Array, "v 3"]
    """float64, in the units of the input."""
    faces: Int[Array, "f 3"]
    """int32."""
    cluster: Int[Array, " n"]
    """int32, for each vertex of the input the vertex that it became part of; -1 for one that no face used."""


def decimate(
    vertices: Float[Array, "n 3"],
    faces: Int[Array, "m 3"],
    max_faces: int,
    *,
    weights: Float[Array, " n"] | None = None,
    regularisation: float = 0.01,
    shape: float = 0.25,
    altitude: float = 5e-4,
    boundary: float = 1.0,
) -> Decimated:
    """Collapse edges in order of quadric error until at most `max_faces` faces are left, or no edge may collapse.

    Laws: an oriented manifold stays one; Euler characteristic, components and boundary loops stay; no triangle turns
    by more than 75 degrees in one collapse; a mesh with few enough faces comes back unchanged; the same input gives
    the same output on every machine.

    Args:
        vertices: Any units; everything is measured relative to the longest side of the bounding box.
        faces: Indices into `vertices`. Unused vertices are dropped.
        max_faces: Where to stop. More faces are left where topology or the limits on shape forbid every collapse.
        weights: Factor of each vertex's error, all 1 by default; a place with a large one keeps more vertices.
        regularisation: Standard deviation of the normals that is assumed (radians): 0 is plain QEM, larger values
            even out the triangles and cost accuracy where the surface is curved.
        shape: How strongly thin triangles raise the cost of a collapse.
        altitude: Least altitude of a new triangle, relative to the longest side.
        boundary: Weight of the planes through boundary edges.

    Raises:
        ValueError: the arrays are not an oriented manifold with indices in range, or not finite.

    Reference:
        Garland and Heckbert 1997; Trettner and Kobbelt 2020 (the isotropic part).
    """
    points = np.array(vertices, dtype=np.float64, order="C")
    corners = np.array(faces, dtype=np.int32, order="C")
    if not np.isfinite(points).all():
        raise ValueError("vertices: not finite")
    factors = np.ones(len(points)) if weights is None else np.ascontiguousarray(weights, dtype=np.float64)
    if not (np.isfinite(factors) & (factors > 0)).all():
        raise ValueError("weights: need positive finite numbers")
    cluster = np.empty(len(points), dtype=np.int32)
    vertex_count, face_count = _decimate.decimate(
        points, corners, factors, cluster, min(max_faces, 2**31 - 1), regularisation, boundary, shape, altitude
    )
    return Decimated(points[:vertex_count].copy(), corners[:face_count].copy(), cluster)
