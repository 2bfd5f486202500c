"""From trained parameters to what the asset stores: the field stays, within its budget, and decodes to itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from small_surfaces import (
    CENTER,
    RADIUS,
    Altered,
    SphereProjector,
    base_points,
    random_parameters,
    small_geometry,
    sphere_mesh,
    tiny_config,
)
from torch import Tensor

from ndf_core.asset.asset import Asset
from ndf_core.asset.content import AssetContent, FieldBlock, QuantisedArray, values_of
from ndf_core.base_mesh.quantise import EncodedBaseMesh, encode_base_mesh
from ndf_core.fitting import quantise as quantise_module
from ndf_core.fitting.blocks import NumpyField, field_blocks, parameters_of
from ndf_core.fitting.compact import canonical_features
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.identity import initial_parameters
from ndf_core.fitting.network import Parameters, displace, interpolate, invert
from ndf_core.fitting.observer import Silent
from ndf_core.fitting.projection import BoxProjector
from ndf_core.fitting.quantise import quantise
from ndf_core.fitting.sampling import BasePoints, generator_at, mapped_areas, stratified
from ndf_core.fitting.trainer import Trainer
from ndf_core.interfaces import BaseMesh, Projection

BOX_TOLERANCE = 3e-6
"""1e-6 of the longest side, which is 3 in the box frame."""
FIXED = 20_000


@dataclass
class Fitted:
    """A short fit of the sphere."""

    base: EncodedBaseMesh
    geometry: BaseGeometry
    projector: BoxProjector
    trained: Tensor
    """The flat parameters before anything was done to them."""
    shape: Parameters

    def parameters(self) -> Parameters:
        return Parameters(self.shape.shape, self.trained.clone())

    def fixed(self) -> BasePoints:
        """Samples that neither training nor quantising has seen."""
        density = mapped_areas(self.geometry, self.parameters())
        return stratified(self.geometry, density, FIXED, generator_at(12345, 7))

    def map(self, parameters: Parameters, base: BasePoints) -> Tensor:
        features = interpolate(parameters.features, base.batch.corners, base.barycentric)
        return displace(parameters, base.batch.positions, features)

    def rms(self, parameters: Parameters, base: BasePoints) -> float:
        points = self.map(parameters, base)
        return float((points - self.projector.project(points).points).double().square().sum(1).mean().sqrt())

    def cycle(self, parameters: Parameters, base: BasePoints) -> float:
        back = invert(parameters, self.map(parameters, base))
        return float((back - base.batch.positions).double().square().sum(1).mean())


def step_of(array: object) -> float:
    assert isinstance(array, QuantisedArray)
    return array.step


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    base = encode_base_mesh(BaseMesh(*sphere_mesh()))
    geometry = BaseGeometry(base.vertices, base.faces)
    projector = BoxProjector(SphereProjector(), base.center, base.scale)
    config = tiny_config(steps=400, batch=400, hidden_width=32)
    parameters = initial_parameters(geometry, config)
    Trainer(parameters, geometry, projector, config, Silent()).run(400, lambda: None)
    return Fitted(base, geometry, projector, parameters.flat.clone(), parameters)


@pytest.fixture(scope="module")
def stored(fitted: Fitted) -> dict[str, FieldBlock]:
    return quantise(fitted.parameters(), fitted.geometry, fitted.projector, 0, keep_inverse=True)


def test_the_fit_is_one(fitted: Fitted) -> None:
    """Else the laws below would say little: ten times closer than the base mesh."""
    start = initial_parameters(fitted.geometry, tiny_config())
    base = fitted.fixed()
    assert fitted.rms(fitted.parameters(), base) < 0.1 * fitted.rms(start, base)


class TestCanonicalFeatures:
    def canonical(self, fitted: Fitted) -> Parameters:
        parameters = fitted.parameters()
        base = stratified(fitted.geometry, fitted.geometry.areas, 2000, generator_at(0, 0))
        canonical_features(parameters, fitted.geometry, base)
        return parameters

    def test_the_field_does_not_change(self, fitted: Fitted) -> None:
        base = fitted.fixed()
        before, after = fitted.parameters(), self.canonical(fitted)
        assert not torch.equal(before.features, after.features)
        assert float((fitted.map(before, base) - fitted.map(after, base)).abs().max()) < 1e-5
        for name in before.views:
            if name not in ("features", "forward.weight.0", "forward.bias.0"):
                assert torch.equal(before.views[name], after.views[name])

    def test_features_are_centred_uncorrelated_and_of_unit_size(self, fitted: Fitted) -> None:
        features = self.canonical(fitted).features.double()
        covariance = features.T @ features / len(features)
        scale = torch.outer(covariance.diagonal(), covariance.diagonal()).sqrt()
        off = (covariance / scale) - torch.eye(len(scale), dtype=torch.float64)
        assert float(features.mean(0).abs().max()) < 1e-5
        assert float(off.abs().max()) < 1e-3
        assert float(covariance.diagonal().mean()) == pytest.approx(1, rel=1e-4)
        values = covariance.diagonal()
        assert bool((values[:-1] >= values[1:]).all()), "largest first"

    def test_without_features_and_with_dead_ones(self, fitted: Fitted) -> None:
        geometry = small_geometry()
        base = BasePoints(geometry, *base_points(geometry, 200))
        for parameters in (random_parameters(geometry, feature_dim=0), random_parameters(geometry)):
            if parameters.shape.feature_dim:
                parameters.views["forward.weight.0"][:, -2:] = 0  # the network ignores two of them
            before = fitted.map(parameters, base)
            canonical_features(parameters, geometry, base)
            torch.testing.assert_close(fitted.map(parameters, base), before, rtol=0, atol=1e-5)


class TestBudget:
    def test_error_at_fixed_samples(self, fitted: Fitted, stored: dict[str, FieldBlock]) -> None:
        """At most 3% more than unquantised; and not so fine that bytes are wasted."""
        decoded = parameters_of(fitted.shape.shape, stored, fitted.parameters())
        base = fitted.fixed()
        growth = fitted.rms(decoded, base) / fitted.rms(fitted.parameters(), base)
        assert growth <= 1.03
        assert growth >= 1.002

    def test_cycle_loss(self, fitted: Fitted, stored: dict[str, FieldBlock]) -> None:
        decoded = parameters_of(fitted.shape.shape, stored, fitted.parameters())
        base = fitted.fixed()
        # A tenth for the inverse, and what the forward network has moved by.
        assert fitted.cycle(decoded, base) <= 1.25 * fitted.cycle(fitted.parameters(), base)

    def test_a_looser_budget_takes_coarser_steps(
        self, fitted: Fitted, stored: dict[str, FieldBlock], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(quantise_module, "RMS_BUDGET", 1.0)
        loose = quantise(fitted.parameters(), fitted.geometry, fitted.projector, 0, keep_inverse=False)
        assert step_of(loose["displacement"].features) > 2 * step_of(stored["displacement"].features)

    def test_projectors_that_need_directions_get_normals(self, fitted: Fitted) -> None:
        """Outward unit normals of the mapped surface, as in training."""
        worst: list[float] = []

        def look(query: Tensor, answer: Projection) -> Projection:
            directions = inner.directions[-1]
            assert directions is not None and answer.normals is not None
            worst.append(float((directions * answer.normals).sum(1).min()))
            return answer

        inner = Altered(SphereProjector(), look, needs_directions=True)
        projector = BoxProjector(inner, fitted.base.center, fitted.base.scale)
        quantise(fitted.parameters(), fitted.geometry, projector, 0, keep_inverse=False)
        assert min(worst) > 0.8


class TestStorage:
    def test_every_tensor_is_on_its_grid(self, fitted: Fitted, stored: dict[str, FieldBlock]) -> None:
        """Nearest codes of the canonical parameters, int16, with a step that float32 holds."""
        parameters = fitted.parameters()
        again = quantise(parameters, fitted.geometry, fitted.projector, 0, keep_inverse=True)
        for network, block in (("forward", again["displacement"]), ("inverse", again["inverse"])):
            arrays = {f"{network}.weight.{i}": array for i, array in enumerate(block.weights)}
            arrays |= {f"{network}.bias.{i}": array for i, array in enumerate(block.biases)}
            if network == "forward":
                arrays["features"] = block.features
            for name, array in arrays.items():
                assert isinstance(array, QuantisedArray)
                assert array.codes.dtype == np.int16
                assert array.step == float(np.float32(array.step)) > 0
                exact = parameters.views[name].numpy()
                off = np.abs(values_of(array) - exact)
                assert off.max(initial=0) <= array.step * (0.5 + 1e-3) + 1e-6 * np.abs(exact).max(initial=0)
        assert again["inverse"].feature_dim == 0

    def test_the_decoded_asset_is_the_torch_field(self, fitted: Fitted, stored: dict[str, FieldBlock]) -> None:
        """Through bytes and the client's kernel, within 1e-6 of the longest side."""
        base = fitted.base
        content = AssetContent(base.vertices, base.faces, base.center, base.scale, stored, {}, base.blob)
        asset = Asset(content)
        decoded = parameters_of(fitted.shape.shape, stored, fitted.parameters())
        points = fitted.fixed()
        faces = points.face.numpy().astype(np.int32)
        weights = points.barycentric.double().numpy()
        expected = fitted.map(decoded, points).numpy()
        assert np.abs(asset.evaluate(faces, weights) - expected).max() < BOX_TOLERANCE
        back = invert(decoded, torch.from_numpy(expected)).numpy()
        found = asset.evaluator("inverse").at_points(expected.astype(np.float64))
        assert np.abs(found - back).max() < BOX_TOLERANCE

    def test_without_inverse(self, fitted: Fitted) -> None:
        blocks = quantise(fitted.parameters(), fitted.geometry, fitted.projector, 0, keep_inverse=False)
        assert list(blocks) == ["displacement"]

    def test_an_untrained_field_stores_the_identity(self, fitted: Fitted) -> None:
        """Last layers are zero: no step can change the error, none may break anything."""
        parameters = initial_parameters(fitted.geometry, tiny_config())
        blocks = quantise(parameters, fitted.geometry, fitted.projector, 0, keep_inverse=True)
        decoded = parameters_of(parameters.shape, blocks, parameters)
        base = fitted.fixed()
        assert torch.equal(fitted.map(decoded, base), base.batch.positions)


class TestBlocks:
    @pytest.mark.parametrize("keep_inverse", [True, False])
    def test_round_trip(self, keep_inverse: bool) -> None:
        geometry = small_geometry()
        parameters = random_parameters(geometry, hidden_layers=3)
        blocks = field_blocks(parameters.shape, lambda name: parameters.views[name].numpy(), keep_inverse)
        other = random_parameters(geometry, hidden_layers=3, seed=1)
        found = parameters_of(parameters.shape, blocks, other)
        for name, view in found.views.items():
            source = other if name.startswith("inverse") and not keep_inverse else parameters
            assert torch.equal(view, source.views[name])

    def test_metadata(self) -> None:
        geometry = small_geometry()
        parameters = random_parameters(geometry)
        blocks = field_blocks(parameters.shape, lambda name: parameters.views[name].numpy(), True)
        forward, inverse = blocks["displacement"], blocks["inverse"]
        assert (forward.kind, forward.domain, forward.feature_dim) == ("displacement", "base", 4)
        assert (inverse.kind, inverse.domain, inverse.feature_dim) == ("inverse", "space", 0)
        assert forward.encoding == inverse.encoding == parameters.shape.encoding
        assert forward.residual and inverse.residual
        assert [weight.shape for weight in forward.weights] == [(16, 25), (16, 16), (3, 16)]

    def test_numpy_field_is_the_torch_field(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("ndf_core.fitting.blocks._CHUNK", 70)
        geometry = small_geometry()
        parameters = random_parameters(geometry)
        face, weights = base_points(geometry, 200)
        base = BasePoints(geometry, face, weights)
        field = NumpyField(parameters, geometry)
        faces, barycentric = face.numpy().astype(np.int32), weights.double().numpy()
        features = interpolate(parameters.features, base.batch.corners, weights)
        expected = displace(parameters, base.batch.positions, features)
        np.testing.assert_allclose(field.map(faces, barycentric), expected.numpy(), atol=1e-6)
        np.testing.assert_allclose(field.base(faces, barycentric), base.batch.positions.numpy(), atol=1e-6)
        np.testing.assert_allclose(
            field.inverse(expected.double().numpy()), invert(parameters, expected).numpy(), atol=1e-6
        )
        assert field.map(faces[:0], barycentric[:0]).shape == (0, 3)


def test_the_frame_is_the_boxs(fitted: Fitted) -> None:
    np.testing.assert_allclose(fitted.base.center, CENTER, atol=RADIUS * 1e-3)
    assert fitted.base.scale == pytest.approx(RADIUS * 2 / 3, rel=0.06)
