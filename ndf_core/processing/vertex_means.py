"""Means over the faces around each vertex, weighted by the faces' angles there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.mesh import corner_angles, face_normals, unit


def vertex_normals(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "v 3"]:
    """Unit; zero where the faces' normals cancel."""
    return _mean_directions(faces, len(vertices), corner_angles(vertices, faces), face_normals(vertices, faces))


def tangents_at_vertices(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], vectors: Float[Array, "f 3"]
) -> tuple[Float[Array, "v 3"], Float[Array, "v 3"]]:
    """`vertex_normals`, and unit tangents there in the mean of the directions of the faces' vectors, or zero."""
    angles = corner_angles(vertices, faces)
    normals = _mean_directions(faces, len(vertices), angles, face_normals(vertices, faces))
    means = _mean_directions(faces, len(vertices), angles, vectors)
    return normals, unit(means - (means * normals).sum(axis=1, keepdims=True) * normals)


def _mean_directions(
    faces: Int[Array, "f 3"], count: int, angles: Float[Array, "f 3"], vectors: Float[Array, "f 3"]
) -> Float[Array, "v 3"]:
    directions = unit(vectors)
    sums = [np.bincount(faces.ravel(), (angles * directions[:, k, None]).ravel(), count) for k in range(3)]
    return unit(np.stack(sums, axis=1))
