"""Shapes that the tests sample."""

from __future__ import annotations

import numpy as np
import trimesh

from ndf_core.kernels.bvh import TriangleBVH


def ring() -> trimesh.Trimesh:
    """A torus of genus 1, away from the origin."""
    mesh = trimesh.creation.torus(1.0, 0.35, major_sections=96, minor_sections=48)
    mesh.apply_translation([3.0, -2.0, 1.0])
    return mesh


def cloud(mesh: trimesh.Trimesh, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points even by area, and normals of their faces."""
    points, face = trimesh.sample.sample_surface(mesh, count, seed=seed)
    return np.asarray(points), np.asarray(mesh.face_normals[face])


def near(mesh: trimesh.Trimesh, count: int, height: float, seed: int = 1) -> np.ndarray:
    """Points up to `height` sizes off the surface."""
    points, normals = cloud(mesh, count, seed)
    rng = np.random.default_rng(seed)
    return points + normals * rng.uniform(-height, height, (count, 1)) * mesh.extents.max()


def off_surface(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Distance to the mesh, in sizes."""
    return closest(mesh, points)[1] / mesh.extents.max()


def closest(mesh: trimesh.Trimesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closest points of the mesh, their distances, and their faces."""
    found, face, _ = TriangleBVH(np.asarray(mesh.vertices), np.asarray(mesh.faces)).closest(points)
    return found, np.linalg.norm(found - points, axis=1), face
