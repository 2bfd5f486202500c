"""The shapes that the project ships: they open, project, and have the genus that they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from ndf_plugin_sdf.analytic import AnalyticConfig
from ndf_plugin_sdf.analytic_surface import open_analytic

from ndf_core.base_mesh.level_set import LevelSetExtractor
from ndf_core.mesh import topology

SHAPES = Path(__file__).resolve().parents[2] / "examples" / "shapes"
GENUS = {"bracket.toml": 6, "teapot.toml": 2, "functions.py:trefoil": 1, "functions.py:gyroid_ball": 26}


def test_every_shape_is_tested() -> None:
    assert {path.name for path in SHAPES.glob("*.toml")} == {name for name in GENUS if name.endswith(".toml")}


@pytest.mark.parametrize("name", GENUS)
def test_shapes_open_and_project(name: str) -> None:
    surface = open_analytic(str(SHAPES / name), AnalyticConfig())
    assert surface.sample is not None
    points, _ = surface.sample(500, np.random.default_rng(0))
    size = np.ptp(points, axis=0).max()
    near = points + np.random.default_rng(1).normal(size=points.shape) * 0.003 * size
    answer = surface.projector.project(torch.from_numpy(near))
    assert answer.converged.double().mean() > 0.995
    moved = (answer.points - torch.from_numpy(near)).norm(dim=1)
    assert float(moved.mean()) < 0.003 * size  # of three normal coordinates, one points at the surface


@pytest.mark.slow
@pytest.mark.parametrize("name", GENUS)
def test_shapes_have_their_genus(name: str) -> None:
    extractor = open_analytic(str(SHAPES / name), AnalyticConfig(resolution=128)).base_mesh
    assert isinstance(extractor, LevelSetExtractor)
    vertices, faces, _ = extractor.dense()
    counts = topology(faces, len(vertices))
    assert (counts.components, counts.genus) == (1, GENUS[name])
