"""The hand-written step of learned fields against autograd, and the losses against torch's."""

from __future__ import annotations

import math

import pytest
import torch
from small_surfaces import base_points, small_geometry

from ndf_core.asset.content import Encoding
from ndf_core.config.field import FieldConfig
from ndf_core.fitting.field_fit import evaluate
from ndf_core.fitting.field_losses import loss_of
from ndf_core.fitting.field_step import FieldStep
from ndf_core.fitting.network import NetworkShape, Parameters
from ndf_core.fitting.sampling import BasePoints

ROWS = 50


def parameters_for(latent: tuple[int, int], outputs: int, features: int = 4, layers: int = 2) -> Parameters:
    shape = NetworkShape(
        Encoding(1.0, 3, include_position=True),
        16,
        layers,
        len(small_geometry().vertices),
        features,
        outputs,
        ("forward",),
        latent,
    )
    return Parameters.initial(shape, 3, zero_last=False, feature_scale=1.0)


@pytest.mark.parametrize("latent", [(0, 0), (1, 3), (5, 2)])
@pytest.mark.parametrize(("features", "layers"), [(4, 2), (0, 1)])
@pytest.mark.parametrize("kind", ["continuous", "binary", "categorical"])
def test_values_and_gradients_are_autograds(latent: tuple[int, int], features: int, layers: int, kind: str) -> None:
    geometry = small_geometry()
    parameters = parameters_for(latent, 3, features, layers)
    base = BasePoints(geometry, *base_points(geometry, ROWS))
    targets = torch.nn.functional.one_hot(torch.arange(ROWS) % 3, 3).float().expand(max(1, latent[0]), -1, -1)
    loss = loss_of(FieldConfig.model_validate({"kind": kind}))

    live = Parameters(parameters.shape, parameters.flat.clone().requires_grad_())
    reference = evaluate(live, base)
    known = {
        "continuous": lambda: torch.nn.functional.mse_loss(reference, targets),
        "binary": lambda: torch.nn.functional.binary_cross_entropy_with_logits(reference, targets),
        "categorical": lambda: torch.nn.functional.cross_entropy(reference.flatten(0, 1), targets.flatten(0, 1)),
    }[kind]()
    (gradient,) = torch.autograd.grad(known, live.flat)

    step = FieldStep(parameters.shape, ROWS)
    outputs = step.evaluate(parameters, base.batch)
    assert torch.allclose(outputs, reference, atol=1e-5)
    value, into_outputs = loss(outputs, targets)
    assert value == pytest.approx(float(known.detach()), rel=1e-5)
    step.backward(parameters, base.batch, into_outputs)
    assert torch.allclose(step.gradient.flat, gradient, atol=1e-6, rtol=1e-3)
    assert float(gradient.abs().max()) > 1e-3


def test_the_absolute_loss_is_least_at_the_median() -> None:
    loss = loss_of(FieldConfig.model_validate({"loss": "absolute"}))
    targets = torch.tensor([0.0, 0.0, 1.0, 50.0, 60.0]).view(1, 5, 1)
    value, gradient = loss(torch.full((1, 5, 1), 1.0), targets)
    assert value == pytest.approx((1 + 1 + 0 + 49 + 59) / 5)
    assert gradient.flatten().tolist() == pytest.approx([0.2, 0.2, 0, -0.2, -0.2])


def test_cross_entropy_has_its_minus_sign() -> None:
    """Sec. 3.5 prints the binary one without."""
    loss = loss_of(FieldConfig.model_validate({"kind": "binary"}))
    assert loss(torch.zeros(1, 1, 1), torch.ones(1, 1, 1))[0] == pytest.approx(math.log(2))
