"""Fields brought to a size in bytes: they keep it, and are nearer than plain rounding at the same size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_assets import icosphere, small_content

from ndf_core.asset.asset import Asset
from ndf_core.asset.file import asset_bytes
from ndf_core.config.field import FieldConfig
from ndf_core.errors import ConfigError
from ndf_core.fitting import field_samples
from ndf_core.fitting.field_fit import evaluate, fit_field, learn
from ndf_core.fitting.field_samples import FieldSamples, sample_values
from ndf_core.fitting.field_size import FeatureSearch, Standard, code_bits, coded_size, independent_sets
from ndf_core.fitting.field_values import FieldValues, check_values
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import Parameters
from ndf_core.fitting.quantise import Grids, rounded
from ndf_core.kernels.codes import encode_codes

POINTS = icosphere(4)[0] * 1.5
NOISE = np.sin(5 * POINTS) + 0.5 * np.random.default_rng(0).standard_normal(POINTS.shape)
"""Smooth, and noise at every point: what no network holds in a few bytes."""


@pytest.fixture(scope="module")
def ball() -> Asset:
    """An icosphere of 320 faces, mapped to itself."""
    return Asset(small_content(icosphere(2), amplitude=0.0))


@pytest.fixture(autouse=True)
def coarse_sampling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field_samples, "_TRIANGLES", 320 * 25)


def small(**options: object) -> FieldConfig:
    given = {"steps": 200, "batch": 512, "encoding_levels": 3, "hidden": 16, "feature_dim": 4, "loss": "absolute"}
    return FieldConfig.model_validate(given | options)


def size_of(asset: Asset) -> int:
    """Bytes of the field's codes."""
    block = asset.content.fields["f"]
    stored = [block.features, *(array for pair in zip(block.weights, block.biases, strict=True) for array in pair)]
    codes = [array.codes for array in stored if not isinstance(array, np.ndarray) and array.codes.size]
    return len(encode_codes([code.reshape(len(code), -1) for code in codes]))


@pytest.mark.parametrize("loss", ["absolute", "squared"])
def test_nearer_than_plain_rounding_at_the_same_size(ball: Asset, loss: str) -> None:
    values = FieldValues(POINTS, NOISE)
    plain = fit_field(ball, values, "f", small(rounding=0.1, loss=loss))
    found = fit_field(ball, values, "f", small(size=size_of(plain.asset), loss=loss))
    assert size_of(found.asset) <= size_of(plain.asset)
    measure = "mean" if loss == "absolute" else "rms"
    assert found.report["error"][measure] < 0.97 * plain.report["error"][measure]
    again = fit_field(ball, values, "f", small(size=size_of(plain.asset), loss=loss))
    assert again.report["error"] == found.report["error"], "the same on every run"


def test_units_of_the_values_do_not_matter(ball: Asset) -> None:
    """The network is trained on in standard units, though stored in those of the values."""
    units = np.array([1e3, 2e3, 4e3])
    plain = fit_field(ball, FieldValues(POINTS, NOISE), "f", small(size=1500))
    scaled = fit_field(ball, FieldValues(POINTS, NOISE * units + 3 * units), "f", small(size=1500))
    faces, barycentric, _ = ball.locate(POINTS)
    one = np.abs(plain.asset.values("f", faces, barycentric) - NOISE).mean(axis=0)
    other = np.abs(scaled.asset.values("f", faces, barycentric) / units - 3 - NOISE).mean(axis=0)
    np.testing.assert_allclose(other, one, rtol=0.15)


def test_a_size_that_is_not_needed_changes_nothing(ball: Asset) -> None:
    plain, bounded = (fit_field(ball, FieldValues(POINTS, NOISE), "f", small(size=n, steps=20)) for n in (0, 10**5))
    assert asset_bytes(plain.asset.content) == asset_bytes(bounded.asset.content)


@pytest.mark.parametrize("features", [0, 4])
def test_any_size_is_kept(ball: Asset, features: int) -> None:
    for size in (600, 1500):
        config = small(size=size, feature_dim=features, steps=30)
        result = fit_field(ball, FieldValues(POINTS, NOISE), "f", config)
        assert size_of(result.asset) <= size
    with pytest.raises(ConfigError, match="does not fit into 1 bytes"):
        fit_field(ball, FieldValues(POINTS, NOISE), "f", small(size=1, feature_dim=features, steps=5))


def test_only_continuous_fields_without_codes(ball: Asset) -> None:
    for config in (small(size=1000, latent=2), small(size=1000, kind="binary", loss="squared")):
        with pytest.raises(ConfigError, match="leave `size` out"):
            fit_field(ball, FieldValues(POINTS, NOISE > 0), "f", config)


@pytest.fixture(scope="module")
def trained(ball: Asset) -> tuple[BaseGeometry, FieldSamples, Standard, Parameters]:
    samples = sample_values(ball, check_values(FieldValues(POINTS, NOISE), "continuous"), "continuous", 1, 0, 1)
    samples = replace(samples, targets=samples.targets.flatten(1)[:, None])
    geometry = BaseGeometry(ball.content.vertices, ball.content.faces)
    learned = learn(geometry, samples, small())
    standard = Standard(learned.shift, learned.scale)
    standard.to_values(learned.parameters)
    return geometry, samples, standard, learned.parameters


def on_grids(parameters: Parameters) -> tuple[Parameters, Grids]:
    grids = {name: float(np.float32(0.5 * float(view.std()))) for name, view in parameters.views.items()}
    return rounded(parameters, grids), grids


def test_features_are_moved_only_where_that_pays(
    trained: tuple[BaseGeometry, FieldSamples, Standard, Parameters],
) -> None:
    geometry, samples, standard, exact = trained
    parameters, grids = on_grids(exact)
    search = FeatureSearch(geometry, samples, standard, small())
    errors, sizes = [search.error(parameters)], [coded_size(parameters, grids)]
    for price in (0.0, 0.0, 1e-4):
        search.run(parameters, grids, price, 1)
        errors.append(search.error(parameters))
        sizes.append(coded_size(parameters, grids))
    assert errors[2] < errors[1] < errors[0], "bits that cost nothing buy a smaller error"
    assert errors[3] > errors[2], "dear bits are saved"
    assert sizes[3] < sizes[2]
    steps = parameters.features / grids["features"]
    assert torch.equal(steps, steps.round()), "they stay on their grid"
    assert torch.equal(parameters.flat[exact.features.numel() :], on_grids(exact)[0].flat[exact.features.numel() :])


def test_the_error_is_that_of_the_loss(trained: tuple[BaseGeometry, FieldSamples, Standard, Parameters]) -> None:
    geometry, samples, standard, parameters = trained
    base, targets = samples.rows(geometry, torch.arange(len(samples)))
    residual = (evaluate(parameters, base) - targets) / standard.scale
    for loss, expected in (("absolute", residual.abs().mean()), ("squared", residual.square().mean())):
        found = FeatureSearch(geometry, samples, standard, small(loss=loss)).error(parameters)
        assert found == pytest.approx(float(expected), rel=1e-5)


def test_standard_outputs_and_back(trained: tuple[BaseGeometry, FieldSamples, Standard, Parameters]) -> None:
    _, _, standard, parameters = trained
    copy = Parameters(parameters.shape, parameters.flat.clone())
    standard.from_values(copy)
    standard.to_values(copy)
    torch.testing.assert_close(copy.flat, parameters.flat)


def test_sets_hold_every_vertex_once_and_no_neighbours() -> None:
    vertices, faces = icosphere(2)
    sets = torch.stack(list(independent_sets(torch.from_numpy(faces).long(), len(vertices))))
    assert (sets.sum(0) == 1).all()
    for one in sets:
        assert one[torch.from_numpy(faces).long()].sum(1).max() <= 1


@pytest.mark.parametrize("spread", [0.3, 1.0, 4.0])
def test_bits_are_what_the_coder_takes(spread: float) -> None:
    rng = np.random.default_rng(1)
    codes = np.round(rng.logistic(0, spread, (5000, 1))).astype(np.int16)
    column = torch.from_numpy(codes[:, 0]).long()
    expected = float(code_bits(column)(column).sum()) / 8
    assert len(encode_codes([codes])) == pytest.approx(expected, rel=0.02, abs=8)
