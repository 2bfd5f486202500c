"""Implicit solids and their meshes, for tests that need surfaces of known topology."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.marching_cubes import marching_cubes
from ndf_core.base_mesh.narrow_band import ScalarField, sample_near_level_set

Points = Float[Array, "n 3"]
Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]
BOX = np.array([[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]])


def ball(points: Points, centre: tuple[float, float, float] = (0.0, 0.0, 0.0), radius: float = 1.0) -> Array:
    return np.linalg.norm(points - np.array(centre), axis=1) - radius


def torus(points: Points, large: float = 1.0, small: float = 0.3) -> Array:
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - large, points[:, 2]) - small


def two_balls(points: Points) -> Array:
    return np.minimum(ball(points, (-0.7, 0, 0), 0.6), ball(points, (0.8, 0, 0), 0.3))


def hollow_ball(points: Points) -> Array:
    return np.maximum(ball(points), -ball(points, radius=0.6))


def bumpy(points: Points) -> Array:
    """Genus 0, with curvature of both signs; the bound |value| <= 1.6 distance holds."""
    return ball(points) + 0.08 * np.sin(6 * points).sum(axis=1)


def mesh_of(field: ScalarField, resolution: int = 32) -> Mesh:
    return marching_cubes(sample_near_level_set(field, BOX, resolution, None))


def tetrahedron() -> Mesh:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32)


def box(sides: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Mesh:
    """Twelve triangles."""
    corners = np.array([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in range(8)], dtype=np.float64)
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    faces = [triangle for a, b, c, d in quads for triangle in ([a, b, c], [a, c, d])]
    return corners * np.array(sides), np.array(faces, dtype=np.int32)


def sheet(count: int = 20) -> Mesh:
    """An open unit square in the plane z = 0, of 2 * count^2 triangles."""
    x, y = np.meshgrid(np.linspace(0, 1, count + 1), np.linspace(0, 1, count + 1), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    i = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    a, b, c, d = i, i + count + 1, i + count + 2, i + 1
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)


def min_angles(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, " f"]:
    """Smallest angle of each triangle, degrees."""
    corner = vertices[faces]
    u, v = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    cosine = (u * v).sum(axis=2) / (np.linalg.norm(u, axis=2) * np.linalg.norm(v, axis=2))
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).min(axis=1)
