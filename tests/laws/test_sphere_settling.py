"""The distortion of flat triangles on a surface, and vertices that settle where there is less of it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from small_assets import icosphere

from ndf_core.fitting.sphere_settling import _energy, _gradients, _slopes, _Triangles, settled
from ndf_core.fitting.sphere_surface import DrawnSurface
from ndf_core.mesh import face_normals, unit

TWIST = 4.0
"""Radians from the middle to a pole."""


def some_triangles(count: int, seed: int) -> tuple[_Triangles, Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Random ones, about half of which face against the normals."""
    rng = np.random.default_rng(seed)
    before, now = rng.standard_normal((2, count, 3, 3))
    faces = np.arange(3 * count).reshape(-1, 3)
    gradients = _gradients(before.reshape(-1, 3), faces)
    normals = unit(rng.standard_normal((count, 3)))
    return _Triangles(now[:, 1], now[:, 2], normals, gradients, np.full(count, 1 / count)), now[:, 0], normals


def test_the_slope_is_the_derivative() -> None:
    triangles, a, normals = some_triangles(200, 0)
    for softness in (1.0, 0.1):
        energy, slope, curvature = _slopes(triangles, a, normals, softness)
        np.testing.assert_allclose(energy, _energy(triangles, a, normals, softness))
        assert (curvature > 0).all()
        for axis in range(3):
            step = 1e-6 * np.eye(3)[axis]
            ahead, behind = (_energy(triangles, a + sign * step, normals, softness) for sign in (1, -1))
            np.testing.assert_allclose((ahead - behind) / 2e-6, slope[:, axis], rtol=1e-4, atol=1e-6 * energy.max())


def test_an_undistorted_triangle_has_the_least() -> None:
    vertices, faces = icosphere(2)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals, shares = unit(face_normals(vertices, faces)), np.full(len(faces), 1 / len(faces))
    triangles = _Triangles(b, c, 0 * normals, _gradients(vertices, faces), shares)
    least = _energy(triangles, a, normals, 0.02)
    np.testing.assert_allclose(least, 4 * shares, rtol=1e-3)
    assert (_energy(triangles, a + 0.02, normals, 0.02) > least).all()
    assert (_energy(triangles, a, -normals, 0.02) > 100 * least).all()


class Twisted(DrawnSurface):
    """The unit sphere, drawn with a twist around z: flat triangles over it fold."""

    def __init__(self) -> None:
        """Nothing has to be drawn."""

    def landed(
        self, drawn: Float[Array, "n 3"]
    ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, "n 3 3"]]:
        points = turned(drawn, TWIST * drawn[:, 2])
        back = np.stack([turned(np.tile(axis, (len(drawn), 1)), -TWIST * points[:, 2]) for axis in np.eye(3)], axis=2)
        back[:, :, 2] -= TWIST * np.cross([0.0, 0.0, 1.0], turned(points, -TWIST * points[:, 2]))
        return points, points, back


def turned(points: Float[Array, "n 3"], angles: Float[Array, " n"]) -> Float[Array, "n 3"]:
    x, y, z = points.T
    sine, cosine = np.sin(angles), np.cos(angles)
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z])


def test_vertices_settle_where_triangles_face_as_the_surface_does() -> None:
    vertices, faces = icosphere(2)
    drawn, surface = unit(vertices), Twisted()
    fixed = np.zeros(len(vertices), dtype=bool)
    fixed[faces[0]] = True

    def against(points: Float[Array, "v 3"]) -> float:
        landed, normals, _ = surface.landed(points)
        crossed = face_normals(landed, faces)
        areas = np.linalg.norm(crossed, axis=1)
        return float(areas[(crossed * normals[faces].sum(axis=1)).sum(axis=1) < 0].sum() / areas.sum())

    found = settled(drawn, vertices, faces, fixed, surface)
    assert against(drawn) > 0.02
    assert against(found) < 1e-3
    np.testing.assert_array_equal(found[fixed], drawn[fixed])
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    assert ((face_normals(found, faces) * found[faces[:, 0]]).sum(axis=1) > 0).all(), "it stays a drawing"
