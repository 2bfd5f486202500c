"""Thickness of solids with a closed form, and that decimation keeps thin parts for it."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray as Array
from small_assets import icosphere

from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.base_mesh.thickness import thickness, thin_weights
from ndf_core.kernels.decimate import decimate


def test_of_a_ball_is_its_diameter() -> None:
    points, faces = icosphere(3)
    found = thickness(3.0 * points, faces.astype(np.int32))
    assert found == pytest.approx(6.0, rel=0.02)


def test_of_an_open_sheet_is_infinite() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float64)
    assert np.isinf(thickness(points, np.array([[0, 1, 2]], np.int32))).all()


def test_weights_are_edge_over_thickness_and_never_below_one() -> None:
    points, faces = icosphere(3)
    thin = thin_weights(points, faces.astype(np.int32), 5.0)
    assert thin == pytest.approx(2.5, rel=0.02)
    assert (thin_weights(points, faces.astype(np.int32), 0.5) == 1.0).all()


def capsule_beside_a_ball(points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """A ball of radius 1, and a rod of radius 0.04 from its surface to x = 3: exact, negative inside."""
    along = np.clip(points[:, 0], 0.9, 2.96)
    rod = np.linalg.norm(points - np.stack([along, 0 * along, 0 * along], axis=1), axis=1) - 0.04
    return np.minimum(np.linalg.norm(points, axis=1) - 1.0, rod)


def test_a_thin_rod_keeps_more_vertices_than_plain_decimation_leaves_it() -> None:
    """Its edges are five times as long as it is thick; the ball keeps nearly as many as it had."""
    bounds = np.array([[-1.2, -1.2, -1.2], [3.2, 1.2, 1.2]])
    policy = LevelSetPolicy(resolution=160, max_resolution=160)
    vertices, faces, _ = LevelSetExtractor(capsule_beside_a_ball, bounds, lipschitz=1.0, policy=policy).dense()
    plain = decimate(vertices, faces, 200).vertices
    base = coarsen(vertices, faces, 200).vertices
    on_rod = [int((points[:, 0] > 1.3).sum()) for points in (plain, base)]
    assert on_rod[1] >= on_rod[0] + 3
    assert on_rod[1] < 30
    assert base[:, 0].max() > 2.9


def test_faces_stay_where_errors_are_important() -> None:
    vertices, faces = icosphere(5)
    base = coarsen(
        vertices, faces.astype(np.int32), 400, importance=lambda points: np.where(points[:, 2] > 0, 64.0, 1.0)
    )
    above = int((base.vertices[base.faces].mean(axis=1)[:, 2] > 0).sum())
    assert above > 1.5 * (len(base.faces) - above)
