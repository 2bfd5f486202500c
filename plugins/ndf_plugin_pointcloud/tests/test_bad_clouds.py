"""Clouds and soups that can be read but make a poor surface: a base mesh, or one clear error."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
import torch
from ndf_plugin_pointcloud.oriented_points import OrientedPointsConfig
from ndf_plugin_pointcloud.oriented_surface import open_oriented_points
from ndf_plugin_pointcloud.points import PointsConfig
from ndf_plugin_pointcloud.points_surface import open_points
from ndf_plugin_pointcloud.soup import SoupConfig
from ndf_plugin_pointcloud.soup_surface import open_soup

from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.errors import NdfError
from ndf_core.interfaces import Surface

pytestmark = pytest.mark.slow

RNG = np.random.default_rng(0)
BALL = RNG.standard_normal((400, 3))
UNIT = BALL / np.linalg.norm(BALL, axis=1, keepdims=True)
CLOUDS = {
    "flat": BALL * [1, 1, 0],
    "nearly a line": BALL * [1, 1e-5, 1e-5],
    "noise without a surface": BALL,
    "ten points": UNIT[:10],
    "two far apart": np.concatenate([UNIT, UNIT + np.array([1e6, 0, 0])]),
    "huge": 1e50 * UNIT,
    "tiny": 1e-50 * UNIT,
    "far from the origin": UNIT + 1e9,
    "one outlier": np.concatenate([UNIT, [[1e9, 0, 0]]]),
}


def assert_opens_or_says_why(make: Callable[[], Surface]) -> None:
    """A base mesh that is manifold and can be projected, or one line that says what is wrong."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            surface = make()
            mesh = surface.base_mesh.extract(200)
        except NdfError as error:
            assert len(str(error).splitlines()) == 1 and len(str(error)) > 20
            return
        check_base_mesh(mesh)
        found = surface.projector.project(torch.from_numpy(mesh.vertices))
        assert bool(torch.isfinite(found.points).all())


@pytest.mark.parametrize("name", CLOUDS)
def test_points(name: str) -> None:
    for config in (PointsConfig(), PointsConfig(orient=True)):
        assert_opens_or_says_why(lambda config=config: open_points(CLOUDS[name], config))


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("normals", [UNIT, RNG.standard_normal((400, 3))], ids=["out", "random"])
def test_oriented_points(name: str, normals: np.ndarray) -> None:
    points = CLOUDS[name]
    vectors = np.resize(normals, points.shape)
    assert_opens_or_says_why(lambda: open_oriented_points((points, vectors), OrientedPointsConfig(resolution=48)))


@pytest.mark.parametrize("name", CLOUDS)
def test_soups(name: str) -> None:
    points = CLOUDS[name]
    faces = np.random.default_rng(1).integers(0, len(points), (6, 3))
    assert_opens_or_says_why(lambda: open_soup((points, faces), SoupConfig(method="winding", resolution=32)))
