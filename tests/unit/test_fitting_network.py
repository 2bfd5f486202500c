"""The networks, their flat parameters, and how they start."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from small_surfaces import base_points, random_parameters, small_geometry, tiny_config

from ndf_core.asset.content import Encoding
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.identity import initial_parameters
from ndf_core.fitting.network import NetworkShape, Parameters, displace, encode, interpolate, invert


def shape(**changes: object) -> NetworkShape:
    values = {"encoding": Encoding(1.0, 2, True), "hidden_width": 5, "hidden_layers": 2, "vertex_count": 7}
    return NetworkShape(**({"feature_dim": 3} | values | changes))


@pytest.mark.parametrize("include", [True, False])
@pytest.mark.parametrize("levels", [0, 1, 8])
def test_encoding_is_sine_and_cosine_per_octave(levels: int, include: bool) -> None:
    """Column by column as `Encoding` says, in numpy and float64."""
    points = np.random.default_rng(0).uniform(-1.5, 1.5, size=(20, 3))
    columns = [points] if include else []
    for k in range(levels):
        angle = 0.7 * 2.0**k * points
        columns += [np.sin(angle), np.cos(angle)]
    expected = np.concatenate(columns, axis=1) if columns else np.zeros((20, 0))
    encoding = Encoding(0.7, levels, include)
    assert encoding.width == expected.shape[1]
    found = encode(torch.from_numpy(points).float(), encoding).numpy()
    np.testing.assert_allclose(found, expected, atol=3e-7 * 2**levels)


class TestParameters:
    def test_views_share_the_flat_vector_and_cover_it_once(self) -> None:
        parameters = Parameters.zeros(shape())
        for value, view in enumerate(parameters.views.values(), start=1):
            assert not view.any(), "written twice"
            view.fill_(value)
        assert bool((parameters.flat > 0).all())
        assert parameters.features is parameters.views["features"]

    def test_sizes(self) -> None:
        sizes = shape().parameter_shapes()
        assert sizes["features"] == (7, 3)
        assert sizes["forward.weight.0"] == (5, 3 + 12 + 3)
        assert sizes["inverse.weight.0"] == (5, 3 + 12)
        assert sizes["forward.weight.2"] == sizes["inverse.weight.2"] == (3, 5)
        assert list(Parameters.zeros(shape()).views) == list(sizes)

    @pytest.mark.parametrize("change", [-1, 1])
    def test_a_vector_of_another_length_is_refused(self, change: int) -> None:
        count = len(Parameters.zeros(shape()).flat)
        with pytest.raises((ValueError, RuntimeError)):
            Parameters(shape(), torch.zeros(count + change))


class TestStart:
    def test_by_construction_both_networks_are_the_identity(self) -> None:
        """To the last bit, whatever the features."""
        geometry = small_geometry()
        parameters = initial_parameters(geometry, tiny_config(identity_steps=0, feature_scale=3.0))
        face, barycentric = base_points(geometry, 100)
        points = geometry.positions(face, barycentric)
        features = interpolate(parameters.features, geometry.faces[face], barycentric)
        assert float(features.abs().max()) > 1
        assert torch.equal(displace(parameters, points, features), points)
        assert torch.equal(invert(parameters, points), points)

    def test_trained_there_as_in_the_paper(self) -> None:
        geometry = small_geometry()
        options = {"optimizer": "muon", "schedule": "cosine", "batch": 256, "learning_rate": 1e-2}

        def error(steps: int) -> tuple[float, float]:
            parameters = initial_parameters(geometry, tiny_config(identity_steps=steps, **options))
            face, barycentric = base_points(geometry, 300)
            points = geometry.positions(face, barycentric)
            features = interpolate(parameters.features, geometry.faces[face], barycentric)
            moved = displace(parameters, points, features) - points
            back = invert(parameters, points) - points
            return float(moved.square().sum(1).mean()), float(back.square().sum(1).mean())

        few, many = error(1), error(150)
        assert many[0] < 0.02 * few[0] and many[1] < 0.02 * few[1]

    def test_weights_are_those_of_linear(self) -> None:
        """Uniform up to 1 / sqrt(fan in), as `torch.nn.Linear` draws them; features normal."""
        geometry = small_geometry()
        config = tiny_config(identity_steps=1, feature_scale=0.5, hidden_width=64, feature_dim=16)
        drawn = Parameters.initial(initial_parameters(geometry, config).shape, 0, zero_last=False, feature_scale=0.5)
        linear = torch.nn.Linear(64, 64)
        weight = drawn.views["forward.weight.1"]
        assert float(weight.abs().max()) == pytest.approx(float(linear.weight.detach().abs().max()), rel=0.02)
        assert float(weight.std()) == pytest.approx(1 / math.sqrt(3 * 64), rel=0.05)
        assert float(drawn.views["inverse.bias.1"].abs().max()) <= 1 / 8
        assert float(drawn.features.std()) == pytest.approx(0.5, rel=0.1)
        assert drawn.views["forward.weight.2"].any()

    def test_high_octaves_start_low_in_the_forward_network_alone(self) -> None:
        geometry = small_geometry()
        plain = initial_parameters(geometry, tiny_config(frequency_damping=1.0))
        damped = initial_parameters(geometry, tiny_config(frequency_damping=0.25))
        ratio = damped.views["forward.weight.0"] / plain.views["forward.weight.0"]
        assert ratio.shape[1] == 3 + 18 + 4
        expected = torch.tensor([1.0] * 3 + [1.0] * 6 + [0.25] * 6 + [0.0625] * 6 + [1.0] * 4)
        torch.testing.assert_close(ratio, expected.expand_as(ratio))
        assert torch.equal(damped.views["inverse.weight.0"], plain.views["inverse.weight.0"])

    def test_the_seed_decides(self) -> None:
        geometry = small_geometry()
        one, same, other = (initial_parameters(geometry, tiny_config(seed=seed)).flat for seed in (1, 1, 2))
        assert torch.equal(one, same)
        assert not torch.equal(one, other)


def test_features_are_barycentric_means() -> None:
    geometry: BaseGeometry = small_geometry()
    parameters = random_parameters(geometry)
    corner = torch.eye(3)
    face = torch.tensor([4, 4, 4])
    found = interpolate(parameters.features, geometry.faces[face], corner)
    torch.testing.assert_close(found, parameters.features[geometry.faces[4]])
    middle = interpolate(parameters.features, geometry.faces[face[:1]], torch.full((1, 3), 1 / 3))
    torch.testing.assert_close(middle[0], found.mean(0))
