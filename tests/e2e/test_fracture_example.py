"""The fracture example: modes of a bar that is known to break at its neck, and what the client makes of them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray as Array
from small_assets import icosphere, small_content

from ndf_core.asset.asset import Asset
from ndf_core.mesh import face_components, topology

FOLDER = str(Path(__file__).resolve().parents[2] / "examples" / "fracture")
sys.path.insert(0, FOLDER)
from client import Shatter, cut, volumes  # noqa: E402  # pyright: ignore
from modes import fracture_modes  # noqa: E402  # pyright: ignore
from server import with_modes  # noqa: E402  # pyright: ignore
from solid import solid_inside  # noqa: E402  # pyright: ignore

sys.path.remove(FOLDER)


def dumbbell() -> tuple[Float[Array, "v 3"], Array]:
    """Unit long, along x, thin in its middle."""
    points, faces = icosphere(3)
    along = np.arccos(np.clip(-points[:, 0], -1, 1)) / np.pi
    width = (0.25 - 0.17 * np.exp(-(((along - 0.5) / 0.15) ** 2))) * np.sin(np.pi * along) ** 0.3
    ring = points[:, 1:] / np.maximum(np.linalg.norm(points[:, 1:], axis=1, keepdims=True), 1e-12)
    return np.column_stack([along - 0.5, width[:, None] * ring]), faces


@pytest.mark.slow
def test_a_dumbbell_breaks_at_its_neck() -> None:
    solid = solid_inside(*dumbbell(), spacing=0.1)
    mode = fracture_modes(solid, 1, weight=1e-3)[0]
    assert len(mode.motions) == 2
    right = solid.centers[:, 0] > 0
    sides = [np.average(right[mode.pieces == piece], weights=solid.volumes[mode.pieces == piece]) for piece in (0, 1)]
    assert min(sides) < 0.1
    assert max(sides) > 0.9
    broken = solid.walls[0][(np.diff(mode.pieces[solid.walls[0]], axis=1) != 0)[:, 0]]
    assert np.abs(solid.centers[broken][..., 0]).max() < 0.25


def test_the_solid_is_elastic() -> None:
    """Rigid motions cost nothing; a stretch by e along x costs (2 mu + lambda) e^2 / 2 of the volume; no jumps."""
    solid = solid_inside(*dumbbell(), spacing=0.15)
    corners = solid.points[solid.tetrahedra].reshape(-1, 3)
    turn = np.cross([0.3, -1.0, 0.7], corners).ravel()
    stretch = np.column_stack([corners[:, 0], np.zeros((len(corners), 2))]).ravel()
    assert abs(turn @ (solid.stiffness @ turn)) < 1e-9
    assert stretch @ (solid.stiffness @ stretch) == pytest.approx(3 * solid.volumes.sum(), rel=1e-9)
    for smooth in (turn, stretch):
        assert np.abs(solid.jumps @ smooth).max() < 1e-12


def test_cutting_keeps_the_surface() -> None:
    vertices, faces = icosphere(3)
    level = vertices @ np.array([0.3, 0.5, 0.8]) - 0.2
    more, finer, values = cut(vertices, faces, level[:, None], level)
    assert topology(finer, len(more)).euler_characteristic == 2
    assert np.linalg.norm(volumes(more, finer, np.zeros(len(finer), int))) == pytest.approx(
        volumes(vertices, faces, np.zeros(len(faces), int))[0], rel=1e-9
    )
    spread = values[:, 0][finer]
    assert ((spread > -0.02).all(axis=1) | (spread < 0.02).all(axis=1)).all(), "no triangle lies on both sides"


@pytest.mark.slow
def test_from_server_to_client(tmp_path: Path) -> None:
    """A ball, whose modes are cuts through its middle: what ships, and closed pieces that fill it."""
    ball = Asset(small_content(icosphere(2), amplitude=0.0))
    fit, _, modes = with_modes(ball, count=1, spacing=0.3, weight=1e-4, steps=250)
    fit.asset.save(tmp_path / "ball.ndf")
    asset = Asset.load(tmp_path / "ball.ndf")
    assert fit.report["columns"] == sum(len(mode.motions) for mode in modes) == asset.content.fields["pieces"].columns
    assert fit.report["error"]["least_overlap"] > 0.9
    shatter = Shatter(asset, asset.longest_side / 30)
    point, direction = np.array([1.5, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])
    assert (shatter.strengths(point, direction) >= 0).all()
    np.testing.assert_allclose(shatter.strengths(point, -2 * direction), shatter.strengths(point, direction))
    whole = 0.0
    for broken in (np.arange(0), np.arange(len(modes))):
        vertices, faces, piece = shatter.pieces(broken)
        counts = topology(faces, len(vertices))
        assert counts.closed
        assert counts.components == piece.max() + 1 == len(np.unique(face_components(faces, len(vertices))))
        parts = volumes(vertices, faces, piece)
        whole = whole or parts.sum()
        assert parts.sum() == pytest.approx(whole, rel=1e-6), "neighbours have the same caps"
    assert len(parts) >= 2
