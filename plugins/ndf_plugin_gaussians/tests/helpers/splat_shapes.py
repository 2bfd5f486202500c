"""Splats on known surfaces."""

from __future__ import annotations

import numpy as np
from ndf_plugin_gaussians.splats import Splats


def on_surface(points: np.ndarray, normals: np.ndarray, width: float, opacity: float = 0.9) -> Splats:
    """Flat splats at points, with the standard deviation `width` along the surface and a tenth of it across."""
    half = normals + np.array([0.0, 0.0, 1.0])
    half[np.linalg.norm(half, axis=1) < 1e-6] = [1.0, 0.0, 0.0]
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    count = len(points)
    return Splats(
        centres=points,
        scales=np.tile([width, width, 0.1 * width], (count, 1)),
        rotations=np.concatenate([np.zeros((count, 1)), half], axis=1),
        opacities=np.full(count, opacity),
        colours=np.full((count, 3), 0.5),
    )


def sphere(count: int = 3000, seed: int = 0, width: float = 0.05) -> Splats:
    """Unit sphere."""
    normals = np.random.default_rng(seed).standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return on_surface(normals, normals, width)


def open_box(count: int = 4000, seed: int = 0) -> Splats:
    """Top and four sides of the box [-1, 1]^2 x [-1.5, 1.5]; there is nothing underneath."""
    rng = np.random.default_rng(seed)
    side = rng.choice(5, count, p=np.array([1.0, 1.5, 1.5, 1.5, 1.5]) / 7.0)
    u, v = rng.uniform(-1, 1, (2, count))
    points, normals = np.empty((count, 3)), np.zeros((count, 3))
    points[side == 0] = np.stack([u, v, np.full(count, 1.5)], axis=1)[side == 0]
    normals[side == 0, 2] = 1.0
    for k, (axis, sign) in enumerate([(0, 1), (0, -1), (1, 1), (1, -1)], start=1):
        rows = side == k
        points[rows, axis], points[rows, 1 - axis], points[rows, 2] = sign, u[rows], 1.5 * v[rows]
        normals[rows, axis] = sign
    return on_surface(points, normals, 0.06)


def floor(count: int = 4000, seed: int = 1) -> Splats:
    """The square [-2, 2]^2 at height 0."""
    points = np.random.default_rng(seed).uniform(-2, 2, (count, 3)) * [1.0, 1.0, 0.0]
    return on_surface(points, np.tile([0.0, 0.0, 1.0], (count, 1)), 0.06)


def joined(*parts: Splats) -> Splats:
    names = ("centres", "scales", "rotations", "opacities", "colours")
    return Splats(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
