"""A fine triangulation of the mapped surface that knows the base points of its vertices, and the search on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.asset.fields import FieldEvaluator
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals

Map = Callable[[Int[Array, " n"], Float[Array, "n 3"]], Float[Array, "n 3"]]
"""(faces, barycentric) -> mapped points in the box frame."""

_TRIANGLES = 500_000
"""Size of the mesh that stands for the mapped surface; its chords are off by a few 1e-6 of the longest side."""
_SEARCHED = 200_000
"""Size of the mesh that closest points are searched on."""


@dataclass(frozen=True)
class DenseMap:
    """A fine triangulation of the mapped surface, with the base points of its vertices. Box frame."""

    vertices: Float[Array, "m 3"]
    triangles: Int[Array, "t 3"]
    base_faces: Int[Array, " m"]
    barycentric: Float[Array, "m 3"]

    def base_points(
        self, triangles: Int[Array, " n"], weights: Float[Array, "n 3"]
    ) -> tuple[Int[Array, " n"], Float[Array, "n 3"]]:
        """Base faces and barycentric weights there of points of the triangles; no triangle leaves its base face."""
        corners = self.triangles[triangles]
        return self.base_faces[corners[:, 0]], np.einsum("nc,ncb->nb", weights, self.barycentric[corners])


def dense_map(face_count: int, mapping: Map, triangles: int = _TRIANGLES) -> DenseMap:
    """Every base face cut into k^2 similar triangles and mapped, with k such that about `triangles` come out."""
    k = max(1, round((triangles / face_count) ** 0.5))
    row, column = np.array([(i, j) for i in range(k + 1) for j in range(k + 1 - i)]).T
    local = np.stack([k - row - column, column, row], axis=1) / k
    index = np.full((k + 2, k + 2), -1)
    index[row, column] = np.arange(len(row))
    up = [(index[i, j], index[i, j + 1], index[i + 1, j]) for i in range(k) for j in range(k - i)]
    down = [(index[i, j + 1], index[i + 1, j + 1], index[i + 1, j]) for i in range(k) for j in range(k - i - 1)]
    cells = np.array(up + down)
    faces = np.repeat(np.arange(face_count, dtype=np.int32), len(local))
    barycentric = np.tile(local, (face_count, 1))
    tiled = (cells[None] + len(local) * np.arange(face_count)[:, None, None]).reshape(-1, 3).astype(np.int32)
    return DenseMap(mapping(faces, barycentric).astype(np.float64), tiled, faces, barycentric)


def even_samples(
    dense: DenseMap, count: int, rng: np.random.Generator
) -> tuple[Int[Array, " n"], Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Base points even by area on the mapped surface, and the unit normals of the mapped triangles they lie in."""
    area_vectors = face_normals(dense.vertices, dense.triangles)
    areas = np.linalg.norm(area_vectors, axis=1)
    chosen = rng.choice(len(areas), count, p=areas / areas.sum())
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    local = np.stack([1 - root, root * (1 - along), root * along], axis=1)
    faces, barycentric = dense.base_points(chosen, local)
    return faces, barycentric, area_vectors[chosen] / areas[chosen][:, None]


class BaseLocator:
    """Finds the base points that are mapped closest to points in space. Box frame."""

    def __init__(self, displacement: FieldEvaluator, face_count: int) -> None:
        self._displacement, self._face_count = displacement, face_count

    @cached_property
    def dense(self) -> DenseMap:
        """The mesh that is searched."""
        return dense_map(self._face_count, self._displacement.at_base, _SEARCHED)

    def closest(
        self, points: Float[Array, "n 3"], threads: int = 1
    ) -> tuple[Int[Array, " n"], Float[Array, "n 3"], Float[Array, " n"]]:
        """Base faces, barycentric weights, and distances of the mapped points from the queries.

        Raises:
            ValueError: a point is not finite.
        """
        near, triangles, weights = self._tree.closest(points, threads)
        faces, barycentric = self.dense.base_points(triangles, weights)
        return faces, barycentric, np.linalg.norm(near - points, axis=1)

    @cached_property
    def _tree(self) -> TriangleBVH:
        return TriangleBVH(self.dense.vertices, self.dense.triangles)
