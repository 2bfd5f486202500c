"""Learned fields on a sphere: they are what was given, anywhere, in the file, without torch."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from small_assets import icosphere, small_content

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.config.field import FieldConfig
from ndf_core.errors import AssetError, ConfigError, InputError
from ndf_core.fitting import field_samples
from ndf_core.fitting.field_fit import FieldFit, fit_field, learn
from ndf_core.fitting.field_samples import sample_values
from ndf_core.fitting.field_values import FieldValues, check_values
from ndf_core.fitting.geometry import BaseGeometry

CENTER, SCALE = (10.0, 20.0, 30.0), 2.0
FINE, FINE_FACES = icosphere(4)
FINE_POINTS = FINE * SCALE * 1.5 + CENTER


@pytest.fixture(scope="module")
def ball() -> Asset:
    """An icosphere of 320 faces, mapped to itself; its radius is 1.5 in the box."""
    return Asset(small_content(icosphere(2), amplitude=0.0, center=CENTER, scale=SCALE))


@pytest.fixture(autouse=True)
def coarse_sampling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field_samples, "_TRIANGLES", 320 * 25)


def small(**options: object) -> FieldConfig:
    return FieldConfig.model_validate({"steps": 250, "batch": 512, "samples": 20_000, "encoding_levels": 4} | options)


def direction(asset: Asset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Base points all over, and the direction of each from the centre."""
    rng = np.random.default_rng(5)
    faces = rng.integers(0, len(asset.content.faces), 4000).astype(np.int32)
    barycentric = rng.dirichlet((1, 1, 1), 4000)
    points = asset.map_points(faces, barycentric) - CENTER
    return faces, barycentric, points / np.linalg.norm(points, axis=1, keepdims=True)


def test_a_vector_field_on_a_mesh(ball: Asset) -> None:
    result = fit_field(ball, FieldValues(FINE_POINTS, FINE, FINE_FACES), "normal", small(), ("x", "y", "z"))
    faces, barycentric, true = direction(ball)
    found = result.asset.values("normal", faces, barycentric)
    assert found.shape == (4000, 3)
    assert np.sqrt(((found - true) ** 2).mean()) < 0.03
    assert result.report["error"]["relative"] < 0.06
    assert result.asset.info()["fields"]["normal"]["labels"] == ["x", "y", "z"]
    assert "normal" not in ball.content.fields, "the asset given stays as it is"
    again = fit_field(ball, FieldValues(FINE_POINTS, FINE, FINE_FACES), "normal", small(), ("x", "y", "z"))
    assert np.array_equal(again.asset.values("normal", faces, barycentric), found), "the same on every run"


def test_several_fields_by_latent_codes(ball: Asset, tmp_path: Path) -> None:
    """One output, run once for each code; the file holds the codes."""
    config = small(latent=4, steps=500)
    result = fit_field(ball, FieldValues(FINE_POINTS, FINE, FINE_FACES), "normal", config)
    block = result.asset.content.fields["normal"]
    assert (block.columns, block.latent_shape) == (3, (3, 4))
    assert block.biases[-1].codes.shape == (1,)
    result.asset.save(tmp_path / "a.ndf")
    faces, barycentric, true = direction(ball)
    found = Asset.load(tmp_path / "a.ndf").values("normal", faces, barycentric)
    assert np.array_equal(found, result.asset.values("normal", faces, barycentric))
    assert np.sqrt(((found - true) ** 2).mean()) < 0.1


def test_codes_that_are_given_stay(ball: Asset) -> None:
    """The network learns around them; without codes it learns both."""
    config = small(latent=2, steps=100)
    values = check_values(FieldValues(FINE_POINTS, FINE, FINE_FACES), "continuous")
    samples = sample_values(ball, values, "continuous", 2000, 0, 1)
    geometry = BaseGeometry(ball.content.vertices, ball.content.faces)
    codes = torch.tensor([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    given = learn(geometry, samples, config, codes).parameters.views
    assert torch.equal(given["latent"], codes)
    free = learn(geometry, samples, config).parameters.views
    assert not torch.equal(given["features"], free["features"])


def test_the_mean_of_the_last_steps_is_kept(ball: Asset) -> None:
    """With a constant rate a run is the beginning of every longer one."""
    samples = sample_values(
        ball, check_values(FieldValues(FINE_POINTS, FINE, FINE_FACES), "continuous"), "continuous", 2000, 1, 1
    )
    geometry = BaseGeometry(ball.content.vertices, ball.content.faces)

    def parameters(steps: int, averaged: float = 0.0) -> torch.Tensor:
        config = small(steps=steps, schedule="constant", averaged=averaged)
        return learn(geometry, samples, config).parameters.flat

    last = torch.stack([parameters(steps) for steps in (7, 8, 9, 10)])
    assert (last[0] - last[3]).abs().max() > 1e-3
    torch.testing.assert_close(parameters(10, averaged=0.4), last.mean(0), rtol=0, atol=1e-6)


def test_vectors_by_latent_codes_keep_their_order(ball: Asset) -> None:
    """Field 0 is constant but for noise, so columns in the wrong order would be far off."""
    values = np.stack(
        [np.stack([FINE[:, 0], 3 + 0 * FINE[:, 0]], 1), np.stack([FINE[:, 1], -3 + 0 * FINE[:, 1]], 1)], 1
    )
    result = fit_field(ball, FieldValues(FINE_POINTS, values, FINE_FACES), "two", small(latent=2))
    found = result.asset.values("two", *direction(ball)[:2])
    assert found.mean(axis=0)[[1, 3]] == pytest.approx([3, -3], abs=0.3)


@pytest.mark.parametrize("latent", [0, 3])
def test_binary_fields(ball: Asset, latent: int) -> None:
    values = FINE[:, [0, 2]] > 0.1
    result = fit_field(
        ball, FieldValues(FINE_POINTS, values, FINE_FACES), "half", small(kind="binary", latent=latent)
    )
    faces, barycentric, true = direction(ball)
    found = result.asset.values("half", faces, barycentric)
    assert found.dtype == bool
    assert (found == (true[:, [0, 2]] > 0.1)).mean() > 0.97
    assert result.report["error"]["least_overlap"] > 0.9


def test_a_categorical_field_at_points(ball: Asset) -> None:
    words = np.array(["low", "middle", "top"])[np.digitize(FINE[:, 2], [-0.4, 0.3])]
    result = fit_field(ball, FieldValues(FINE_POINTS, words), "band", small(kind="categorical"))
    assert result.asset.content.fields["band"].labels == ("low", "middle", "top")
    faces, barycentric, true = direction(ball)
    found = result.asset.values("band", faces, barycentric)
    assert (found == np.digitize(true[:, 2], [-0.4, 0.3])).mean() > 0.95


def test_points_may_leave_gaps_and_be_elsewhere(ball: Asset) -> None:
    """Surface without values takes those of the closest points, and is counted; what is far away is left out."""
    seen = FINE[:, 2] > 0
    points = np.concatenate([FINE_POINTS[seen], [[100.0, 0, 0]]])
    values = np.concatenate([np.where(FINE[seen, 2] < 0.3, 5.0, 0.0), [1e6]])
    result = fit_field(ball, FieldValues(points, values), "rim", small())
    faces, barycentric, true = direction(ball)
    found = result.asset.values("rim", faces, barycentric)[:, 0]
    assert np.abs(found[true[:, 2] < -0.3] - 5).max() < 1.0
    assert result.report["left_out"] == 1
    assert 0.3 < result.report["invented"] < 0.6


def test_a_client_without_torch_evaluates_it(ball: Asset, tmp_path: Path) -> None:
    fit_field(ball, FieldValues(FINE_POINTS, FINE, FINE_FACES), "normal", small(steps=20)).asset.save(
        tmp_path / "a.ndf"
    )
    code = (
        "import sys, ndf_core\n"
        f"asset = ndf_core.load({str(tmp_path / 'a.ndf')!r})\n"
        "mesh = asset.extract(0.5)\n"
        "assert asset.values('normal', mesh.base_faces, mesh.barycentric).shape == mesh.vertices.shape\n"
        "assert not {'torch', 'scipy', 'igl'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-P", "-c", code], check=True)


def test_located_points_are_mapped_back_to_where_they_were(ball: Asset) -> None:
    faces, barycentric, _ = direction(ball)
    points = ball.map_points(faces, barycentric)
    found, weights, distances = ball.locate(points)
    assert distances.max() < 1e-5 * SCALE
    assert np.abs(ball.map_points(found, weights) - points).max() < 1e-5 * SCALE


def test_the_public_function(ball: Asset) -> None:
    asset = ndf_core.fit_field(
        ball, FINE[:, 2] > 0, points=FINE_POINTS, faces=FINE_FACES, name="up", kind="binary", steps=30, samples=2000
    )
    assert asset.content.fields["up"].kind == "binary"
    with pytest.raises(ConfigError, match="hidden"):
        ndf_core.fit_field(ball, FINE, points=FINE_POINTS, hidden=0)


@pytest.mark.parametrize("name", ["displacement", "inverse", "two words", "", "a" * 65, "1st", "größe"])
def test_names_that_are_taken_or_none(ball: Asset, name: str) -> None:
    with pytest.raises(ConfigError, match="field name"):
        fit_field(ball, FieldValues(FINE_POINTS, FINE), name, small())


def test_what_else_is_refused(ball: Asset) -> None:
    values = FieldValues(FINE_POINTS, FINE, FINE_FACES)
    with pytest.raises(ConfigError, match="2 labels for 3 columns"):
        fit_field(ball, values, "f", small(), ("a", "b"))
    with pytest.raises(ConfigError, match="printable text"):
        fit_field(ball, values, "f", small(), ("a", "b\n", "c"))
    with pytest.raises(ConfigError, match="latent codes are for several fields"):
        fit_field(ball, values, "f", small(kind="categorical", latent=2))
    for faces in (FINE_FACES, None):
        with pytest.raises(InputError, match="another shape, or in other units"):
            fit_field(ball, FieldValues(FINE_POINTS + 50, FINE, faces), "f", small())
    with pytest.raises(AssetError, match="has no field 'none'"):
        ball.values("none", np.zeros(1, np.int32), np.array([[1.0, 0, 0]]))


def test_features_save_what_a_field_over_positions_cannot_have(ball: Asset) -> None:
    """The point of Sec. 3.5: with features a rough field is learned better at the same size of the network."""
    rough = np.sin(9 * FINE[:, 0]) * np.sin(11 * FINE[:, 1]) * np.sin(7 * FINE[:, 2])
    values = FieldValues(FINE_POINTS, rough, FINE_FACES)

    def error(features: int) -> float:
        result: FieldFit = fit_field(ball, values, "rough", small(feature_dim=features, hidden=16))
        return result.report["error"]["relative"]

    assert error(8) < 0.6 * error(0)
