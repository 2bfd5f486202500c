"""How thick a solid is at each vertex of its boundary, and how much more a thin place counts in decimation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals

_LIFT = 1e-7
"""Rays start this share of the bounding box's diagonal below their triangle."""
_MOST = 20.0
"""Largest weight: what is thinner than this share of an edge keeps no more vertices for it."""


def thickness(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, " v"]:
    """Distance straight through the solid from the middles of the faces around each vertex, the least of them.

    In the units of the vertices; infinite where nothing is behind (open meshes).
    """
    normals = face_normals(vertices, faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    inwards = -np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    start = vertices[faces].mean(axis=1) + _LIFT * float(np.linalg.norm(np.ptp(vertices, axis=0))) * inwards
    usable = np.flatnonzero(length[:, 0] > 0)
    through = np.full(len(faces), np.inf)
    through[usable] = TriangleBVH(vertices, faces).first_hit(start[usable], inwards[usable])[0]
    least = np.full(len(vertices), np.inf)
    np.minimum.at(least, faces.ravel(), np.repeat(through, 3))
    return least


def thin_weights(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], edge: float) -> Float[Array, " v"]:
    """Weights for decimation to edges of about `edge`: 1 where the solid is thicker than that, edge / thickness else.

    A quadric error counts lengths, so a tube much thinner than the edges is cheap to taper into a spike. But a map is
    poor where its base mesh is: points inside of a spike have their closest points on any side of the tube. With the
    weight, an error is judged by its share of the thickness.
    """
    return np.clip(edge / np.maximum(thickness(vertices, faces), 1e-12 * edge), 1.0, _MOST)
