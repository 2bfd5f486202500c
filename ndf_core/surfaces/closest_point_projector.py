"""Projection onto a triangle mesh: the closest point (Sec. 4.2)."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals, unit

_ON_EDGE = 1e-9
"""Barycentric coordinates below this count as zero."""


class ClosestPointProjector(Projector):
    """Closest points of a closed mesh; every row converges.

    Normals are those of the face; on an edge the sum of its two faces' unit normals and at a vertex the sum of its
    faces' weighted by their angles, both made unit. So they do not depend on which of the faces there the search
    happened to find, and their sign tells inside from outside.

    Runs in double precision on the CPU; queries on another device are copied there and back. Uses as many threads as
    torch does.

    Reference: Baerentzen and Aanaes, Signed distance computation using the angle weighted pseudonormal, 2005.
    """

    parallel = True

    def __init__(self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> None:
        # About the middle, so that coordinates far from the origin lose nothing in differences.
        self._middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        centred = vertices - self._middle
        self._tree = TriangleBVH(centred, faces)
        normals = unit(face_normals(centred, faces))
        self._face_normals = normals
        self._edge_normals = _edge_normals(faces, len(vertices), normals)
        self._vertex_normals = _vertex_normals(centred, faces, normals)
        self._faces = faces

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        query = points.detach().to("cpu", torch.float64).numpy()
        finite = np.isfinite(query).all(axis=1)
        if not finite.all():
            raise InputError(f"cannot project query point {int((~finite).argmax())}: a coordinate is not finite")
        found, face, weights = self._tree.closest(query - self._middle, threads=torch.get_num_threads())
        answer = torch.from_numpy(found + self._middle).to(points)
        converged = torch.ones(len(query), dtype=torch.bool, device=points.device)
        return Projection(answer, converged, torch.from_numpy(self._normals(face, weights)).to(points))

    def _normals(self, face: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        normals = self._face_normals[face]
        zero = weights < _ON_EDGE
        count = zero.sum(axis=1)
        on_edge, on_vertex = np.flatnonzero(count == 1), np.flatnonzero(count == 2)
        # The edge opposite to corner i is half-edge i + 1.
        opposite = zero[on_edge].argmax(axis=1)
        normals[on_edge] = self._edge_normals[face[on_edge], (opposite + 1) % 3]
        corner = weights[on_vertex].argmax(axis=1)
        normals[on_vertex] = self._vertex_normals[self._faces[face[on_vertex], corner]]
        return normals


def _edge_normals(faces: Int[Array, "f 3"], vertex_count: int, normals: Float[Array, "f 3"]) -> Float[Array, "f 3 3"]:
    """Of each half-edge (from corner i to the next): the mean direction of the two faces."""
    start, end = faces.astype(np.int64).ravel(), faces[:, [1, 2, 0]].astype(np.int64).ravel()
    forward, backward = start * vertex_count + end, end * vertex_count + start
    order = np.argsort(forward)
    opposite = order[np.searchsorted(forward[order], backward)]
    own = np.repeat(normals, 3, axis=0)
    return unit(own + own[opposite]).reshape(-1, 3, 3)


def _vertex_normals(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], normals: Float[Array, "f 3"]
) -> Float[Array, "v 3"]:
    """Angle-weighted means of the faces' normals."""
    corners = vertices[faces]
    ahead = unit(np.roll(corners, -1, axis=1) - corners)
    behind = unit(np.roll(corners, 1, axis=1) - corners)
    # Half of the angle from chord lengths: exact for the tiny angles that arccos of a product rounds to zero.
    angle = 2.0 * np.arctan2(np.linalg.norm(ahead - behind, axis=2), np.linalg.norm(ahead + behind, axis=2))
    weighted = (angle[:, :, None] * normals[:, None, :]).reshape(-1, 3)
    total = np.stack([np.bincount(faces.ravel(), weighted[:, i], len(vertices)) for i in range(3)], axis=1)
    return unit(total)
