"""Fits with the base mesh of another asset, and fields that go from one such asset to the other."""

from __future__ import annotations

import json
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_assets import icosphere, small_content, torus
from small_surfaces import CENTER, RADIUS, Altered, SphereProjector, sphere_surface, tiny_config
from torch import Tensor

from ndf_core.asset.asset import Asset
from ndf_core.asset.transfer import copy_field
from ndf_core.cli import main
from ndf_core.errors import AssetError, BaseMeshError, ConfigError
from ndf_core.fitting import shared_base
from ndf_core.fitting.pipeline import FitResult, run_fit
from ndf_core.interfaces import Projection, Surface

SMALL = Asset(small_content(icosphere(2), amplitude=0.0))
"""A sphere of radius 1.5 around the origin, with one field beside the displacement."""
AXES = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_base, "TARGET_FACES", 1000)


def turned_fit(folder: Path, asset: Asset = SMALL, surface: Surface | None = None, **how: Any) -> FitResult:
    """The sphere's base mesh on another sphere, turned by 90 degrees."""
    steps = how.pop("steps", 150)
    asset.save(folder / "small.ndf")
    middles = asset.map_points(*asset.locate(1.5 * AXES)[:2])
    pairs = np.column_stack([middles, np.array(CENTER) + RADIUS * AXES @ QUARTER.T])
    np.savetxt(folder / "pairs.csv", pairs, delimiter=",")
    config = tiny_config(base_from=str(folder / "small.ndf"), anchors=str(folder / "pairs.csv"), steps=steps)
    return run_fit(surface or sphere_surface(), config, **how)


@pytest.mark.slow
def test_the_base_mesh_is_the_other_assets_and_anchors_are_met(tmp_path: Path) -> None:
    result = turned_fit(tmp_path)
    content = result.asset.content
    assert content.base_mesh_blob == SMALL.content.base_mesh_blob
    assert content.placement is not None
    np.testing.assert_array_equal(content.vertices, SMALL.content.vertices)
    np.testing.assert_allclose(np.linalg.norm(content.placed, axis=1), 1.5, rtol=0.07, err_msg="on the other sphere")
    np.testing.assert_allclose(content.center, CENTER, atol=0.02 * RADIUS)
    assert result.report["anchors"]["pairs"] == 6
    assert result.report["anchors"]["largest"] < 0.01
    assert result.report["error"]["folded_area"] < 0.01
    assert result.report["projection_rms_relative"] < 0.01
    faces = np.arange(len(content.faces), dtype=np.int32)
    middle = np.full((len(faces), 3), 1 / 3)
    expected = SMALL.map_points(faces, middle) / 1.5 @ QUARTER.T * RADIUS + np.array(CENTER)
    assert np.linalg.norm(result.asset.map_points(faces, middle) - expected, axis=1).mean() < 0.25 * RADIUS
    assert str(tmp_path) not in json.dumps(content.provenance)
    copied = copy_field(with_field("mark"), result.asset, "mark")
    weights = np.random.default_rng(0).dirichlet((1, 1, 1), len(faces))
    np.testing.assert_array_equal(
        copied.evaluate(faces, weights, "mark"), with_field("mark").evaluate(faces, weights, "mark")
    )


@pytest.mark.slow
def test_an_interrupted_map_goes_on(tmp_path: Path) -> None:
    """The checkpoint holds the map: nothing is registered again, and the bytes are the uninterrupted run's."""
    calls = 0

    def press(_query: Tensor, answer: Projection) -> Projection:
        nonlocal calls
        calls += 1
        if calls == 4:
            signal.raise_signal(signal.SIGINT)
        return answer

    output = tmp_path / "map.ndf"
    turned_fit(tmp_path, output=output, steps=12)
    whole = output.read_bytes()
    with pytest.raises(KeyboardInterrupt):
        turned_fit(tmp_path, surface=sphere_surface(Altered(SphereProjector(), press)), output=output, steps=12)
    turned_fit(tmp_path, output=output, resume=True, steps=12)
    assert output.read_bytes() == whole


def test_another_topology_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BaseMeshError, match=r"Euler characteristic 0, the input 1 and 2: a map needs the same"):
        turned_fit(tmp_path, Asset(small_content(torus(), amplitude=0.0)))


def test_a_base_mesh_without_anchors_is_refused() -> None:
    with pytest.raises(ConfigError, match="--base-from: needs --anchors"):
        run_fit(sphere_surface(), tiny_config(base_from="small.ndf"))


def with_field(name: str) -> Asset:
    """The small asset with its displacement's network as a field of values."""
    content = SMALL.content
    block = replace(content.fields["displacement"], name=name, kind="continuous", residual=False)
    return Asset(replace(content, fields={**content.fields, name: block}))


class TestCopy:
    def test_the_command(self, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
        source, target, out = (tmp_path / f"{name}.ndf" for name in ("source", "target", "out"))
        with_field("mark").save(source)
        SMALL.save(target)
        assert main(["field", "copy", str(source), str(target), "--name", "mark", "-o", str(out), "--json"]) == 0
        assert "mark" in json.loads(capfd.readouterr().out)["fields"]
        assert Asset.load(out).content.fields["mark"].kind == "continuous"

    def test_what_is_refused(self) -> None:
        other = Asset(small_content(torus(), amplitude=0.0))
        with pytest.raises(AssetError, match="different base meshes"):
            copy_field(with_field("mark"), other, "mark")
        with pytest.raises(AssetError, match="no learned field 'displacement' to copy; there is mark"):
            copy_field(with_field("mark"), SMALL, "displacement")
        with pytest.raises(AssetError, match="there is none"):
            copy_field(SMALL, SMALL, "mark")
