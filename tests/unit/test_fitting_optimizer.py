"""Adam against torch's, Muon's orthogonalisation, state that survives a checkpoint, the schedule."""

from __future__ import annotations

import math

import pytest
import torch
from small_surfaces import random_parameters, small_geometry, tiny_config
from torch import Tensor

from ndf_core.fitting.network import Parameters
from ndf_core.fitting.optimizer import Optimizer, orthogonalise, rate_factor


def gradients(parameters: Parameters, count: int) -> list[Parameters]:
    generator = torch.Generator().manual_seed(0)
    return [
        Parameters(parameters.shape, torch.randn(len(parameters.flat), generator=generator) * 10.0**-i)
        for i in range(count)
    ]


def test_adam_is_that_of_torch() -> None:
    ours = random_parameters(small_geometry())
    names = [name for name in ours.views if name != "features"]
    theirs = {name: ours.views[name].clone().requires_grad_() for name in ours.views}
    reference = torch.optim.Adam(
        [
            {"params": [theirs[name] for name in names], "lr": 3e-3},
            {"params": [theirs["features"]], "lr": 2e-2},
        ],
        betas=(0.9, 0.95),
    )
    config = tiny_config(optimizer="adam", learning_rate=3e-3, feature_learning_rate=2e-2, adam_beta2=0.95)
    optimizer = Optimizer(ours, config)
    for gradient, factor in zip(gradients(ours, 4), (1.0, 0.5, 2.0, 0.1), strict=True):
        for group, rate in zip(reference.param_groups, (3e-3, 2e-2), strict=True):
            group["lr"] = rate * factor
        for name, view in gradient.views.items():
            theirs[name].grad = view.clone()
        reference.step()
        optimizer.step(gradient, factor)
    for name, view in ours.views.items():
        torch.testing.assert_close(view, theirs[name].detach(), rtol=1e-5, atol=1e-6)


class TestMuon:
    def test_hidden_matrices_move_by_near_isometries_and_the_rest_as_in_adam(self) -> None:
        geometry = small_geometry()
        muon, adam, start = (random_parameters(geometry) for _ in range(3))
        rates = {"learning_rate": 1e-2, "feature_learning_rate": 1e-1}
        (gradient,) = gradients(muon, 1)
        Optimizer(muon, tiny_config(optimizer="muon", **rates)).step(gradient, 0.5)
        Optimizer(adam, tiny_config(optimizer="adam", **rates)).step(gradient, 0.5)
        hidden = {f"{network}.weight.{i}" for network in ("forward", "inverse") for i in (0, 1)}
        for name, view in muon.views.items():
            if name not in hidden:
                torch.testing.assert_close(view, adam.views[name])
                continue
            update = (view - start.views[name]).double()
            rows, columns = update.shape
            values = torch.linalg.svdvals(update) / (2 * 0.5 * 1e-2 * math.sqrt(max(1.0, rows / columns)))
            assert float(values.min()) > 0.2 and float(values.max()) < 1.4
            assert float((update * gradient.views[name]).sum()) < 0, "downhill"

    @pytest.mark.parametrize("shape", [(16, 16), (16, 64), (64, 16), (1, 5)])
    def test_singular_values_go_to_one_and_singular_vectors_stay(self, shape: tuple[int, int]) -> None:
        matrix = random_matrix(shape)
        left, values, right = torch.linalg.svd(matrix.double(), full_matrices=False)
        assert len(values) == 1 or float(values[0] / values[-1]) > 1.5
        turned = left.T @ orthogonalise(matrix, iterations=5).double() @ right.T
        diagonal = turned.diagonal()
        assert float(diagonal.min()) > 0.5 and float(diagonal.max()) < 1.3
        assert float((turned - torch.diag(diagonal)).abs().max()) < 1e-4

    def test_transposing_before_or_after_is_the_same(self) -> None:
        matrix = random_matrix((12, 30))
        torch.testing.assert_close(orthogonalise(matrix.T), orthogonalise(matrix).T)

    @pytest.mark.parametrize("scale", [1e-8, -1.0, 1e6])
    def test_size_does_not_matter_and_sign_stays(self, scale: float) -> None:
        matrix = random_matrix((12, 30))
        torch.testing.assert_close(
            orthogonalise(matrix * scale), math.copysign(1, scale) * orthogonalise(matrix), rtol=1e-4, atol=1e-5
        )

    def test_no_gradient_moves_nothing(self) -> None:
        assert not orthogonalise(torch.zeros(4, 9)).any()


def random_matrix(shape: tuple[int, int]) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("kind", ["adam", "muon"])
def test_state_round_trip(kind: str) -> None:
    """Loaded into a new optimiser it goes on bit for bit as the first would have."""
    parameters = random_parameters(small_geometry())
    config = tiny_config(optimizer=kind)
    steps = gradients(parameters, 6)
    optimizer = Optimizer(parameters, config)
    for gradient in steps[:3]:
        optimizer.step(gradient, 1.0)
    state = {name: tensor.clone() for name, tensor in optimizer.state.items()}
    copy = Parameters(parameters.shape, parameters.flat.clone())
    for gradient in steps[3:]:
        optimizer.step(gradient, 0.7)
    other, forgetful = Optimizer(copy, config), Parameters(copy.shape, copy.flat.clone())
    other.load_state(state)
    fresh = Optimizer(forgetful, config)
    for gradient in steps[3:]:
        other.step(gradient, 0.7)
        fresh.step(gradient, 0.7)
    assert torch.equal(copy.flat, parameters.flat)
    assert not torch.equal(forgetful.flat, parameters.flat), "the state matters"


class TestSchedule:
    def test_cosine_rises_to_its_peak_and_ends_at_zero(self) -> None:
        config = tiny_config(schedule="cosine", steps=1000, warmup_steps=20)
        factors = [rate_factor(config, step) for step in range(1000)]
        assert factors[0] == pytest.approx(1 / 20)
        assert max(factors) == pytest.approx(1.0, abs=2e-3) and factors.index(max(factors)) == 19
        assert factors[500] == pytest.approx(0.5, abs=1e-3)
        assert 0 < factors[-1] < 1e-5
        assert factors[19:] == sorted(factors[19:], reverse=True)

    def test_constant(self) -> None:
        config = tiny_config(schedule="constant", steps=1000, warmup_steps=0)
        assert {rate_factor(config, step) for step in range(1000)} == {1.0}

    def test_without_steps(self) -> None:
        assert math.isfinite(rate_factor(tiny_config(steps=0), 0))
