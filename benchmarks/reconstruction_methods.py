"""The methods that `reconstruction.py` compares with, as Open3D has them. One thread."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import open3d
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

DEPTH = 9
"""Of the octree of Poisson reconstruction; 8 is no better on noisy points, 10 no better on clean ones."""
ALPHA = 1.5
"""Radius of the balls of alpha shapes, in spacings (median distance to the sixth neighbour)."""
BALLS = (1.0, 2.0, 4.0)
"""Radii of ball pivoting, in spacings."""
NEIGHBOURS = 20
"""Of the tangent planes, where normals are estimated."""


class Mesh(NamedTuple):
    vertices: Float[Array, "v 3"]
    faces: Int[Array, "f 3"]


Method = Callable[[Float[Array, "n 3"], Float[Array, "n 3"] | None, bool], Mesh]


def used(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Mesh:
    """Without vertices that no face has, and without faces that name a vertex twice."""
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    kept, index = np.unique(faces, return_inverse=True)
    return Mesh(np.ascontiguousarray(vertices[kept]), index.reshape(-1, 3).astype(np.int32))


def poisson(points: Float[Array, "n 3"], normals: Float[Array, "n 3"] | None, oriented: bool) -> Mesh:
    cloud = point_cloud(points, normals, oriented)
    return from_open3d(
        open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=DEPTH, n_threads=1)[0]
    )


def alpha_shape(points: Float[Array, "n 3"], normals: Float[Array, "n 3"] | None, oriented: bool) -> Mesh:
    del normals, oriented
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return from_open3d(
        open3d.geometry.TriangleMesh.create_from_point_cloud_alpha_shape(cloud, ALPHA * spacing(points))
    )


def ball_pivoting(points: Float[Array, "n 3"], normals: Float[Array, "n 3"] | None, oriented: bool) -> Mesh:
    radii = open3d.utility.DoubleVector([x * spacing(points) for x in BALLS])
    cloud = point_cloud(points, normals, oriented)
    return from_open3d(open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(cloud, radii))


def point_cloud(points: Float[Array, "n 3"], normals: Float[Array, "n 3"] | None, oriented: bool) -> Any:
    """Points with outward normals: those given, made to agree where their signs mean nothing, or estimated ones."""
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    if normals is None:
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    else:
        cloud.normals = open3d.utility.Vector3dVector(normals)
    if not oriented:
        cloud.orient_normals_consistent_tangent_plane(NEIGHBOURS)
        found = np.asarray(cloud.normals)
        if np.einsum("nc,nc->", found, points - points.mean(axis=0)) < 0:
            cloud.normals = open3d.utility.Vector3dVector(-found)
    return cloud


def from_open3d(mesh: Any) -> Mesh:
    return used(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.triangles))


def spacing(points: Float[Array, "n 3"]) -> float:
    return float(np.median(KDTree(points).query(points, k=7)[0][:, 6]))


METHODS: dict[str, Method] = {"Poisson": poisson, "alpha shape": alpha_shape, "ball pivoting": ball_pivoting}
