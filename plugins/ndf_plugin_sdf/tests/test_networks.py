"""Described networks against torch's own modules: values, gradients, what is found from names and shapes."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import torch
from ndf_plugin_sdf.networks.assemble import assemble
from ndf_plugin_sdf.networks.chain import find_chain
from ndf_plugin_sdf.networks.describe import described
from ndf_plugin_sdf.networks.description import NetworkDescription
from ndf_plugin_sdf.networks.encoding import Encoding
from ndf_plugin_sdf.networks.mlp import Mlp
from networks import Ball, NeusSdf, encoded
from torch import Tensor, nn

from ndf_core.errors import InputError


def arrays(module: nn.Module) -> dict[str, np.ndarray]:
    return {name: tensor.numpy() for name, tensor in module.state_dict().items()}


def read(named: dict[str, np.ndarray], **options: Any) -> tuple[Mlp, NetworkDescription, list[str]]:
    given = NetworkDescription(**options)
    chain = find_chain(named, given.prefix)
    description, notes = described(chain, given)
    return assemble(chain, description), description, notes


def assert_agree(network: Mlp, reference: Any, scale: float = 1.0) -> None:
    """Values and gradients of the reference, by autograd."""
    points = torch.rand(300, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64) * 2 - 1
    variable = points.clone().requires_grad_(True)
    expected = reference(variable)
    (slope,) = torch.autograd.grad(expected.sum(), variable)
    values, gradients = network.value_and_gradient(points * scale)
    torch.testing.assert_close(values / scale, expected.detach(), rtol=1e-9, atol=1e-11)
    torch.testing.assert_close(network.value(points * scale), values, rtol=1e-12, atol=1e-13)
    torch.testing.assert_close(gradients, slope, rtol=1e-8, atol=1e-9)


ACTIVATIONS = {
    "relu": (nn.ReLU(), {}),
    "leaky_relu": (nn.LeakyReLU(0.1), {"slope": 0.1}),
    "elu": (nn.ELU(), {}),
    "tanh": (nn.Tanh(), {}),
    "softplus": (nn.Softplus(beta=7), {"beta": 7.0}),
}


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_every_activation_with_its_gradient(name: str) -> None:
    torch.manual_seed(0)
    module, options = ACTIVATIONS[name]
    layers = [nn.Linear(3, 16), module, nn.Linear(16, 24), module, nn.Linear(24, 1)]
    reference = nn.Sequential(*layers).double()
    network, _, _ = read(arrays(reference), activation=name, **options)
    assert_agree(network, lambda x: reference(x)[:, 0])


def test_sines_with_a_first_omega() -> None:
    torch.manual_seed(0)
    layers = [nn.Linear(3, 16), nn.Linear(16, 16), nn.Linear(16, 1)]
    reference = nn.Sequential(*layers).double()

    def siren(x: Tensor) -> Tensor:
        hidden = torch.sin(5.0 * reference[0](x))
        return reference[2](torch.sin(3.0 * reference[1](hidden)))[:, 0]

    assert_agree(read(arrays(reference), activation="sine", omega=3.0, first_omega=5.0)[0], siren)
    assert read(arrays(reference), preset="siren")[1].omega == 30.0


def test_neus_is_recognised_and_computed_as_its_authors_do() -> None:
    torch.manual_seed(0)
    reference = NeusSdf(scale=1.5).double()
    for layer in range(9):  # off the initialisation, where many weights are zero
        nn.init.normal_(getattr(reference, f"lin{layer}").weight_v, 0.0, 0.2)
        nn.init.uniform_(getattr(reference, f"lin{layer}").weight_g, 0.5, 1.5)
    checkpoint = {f"sdf_network_fine.{name}": array for name, array in arrays(reference).items()}
    checkpoint["color_network_fine.lin0.weight"] = np.ones((8, 30))
    checkpoint["color_network_fine.lin1.weight"] = np.ones((3, 8))
    checkpoint["variance_network_fine.variance"] = np.array(0.3)
    network, description, notes = read(checkpoint, input_scale=1.5)
    assert (description.activation, description.beta) == ("softplus", 100.0)
    assert any("neus" in note for note in notes)
    assert "8 x 64" not in notes[0]  # the layer before the skip is narrower
    assert_agree(network, reference, scale=1.5)


def test_the_names_of_newer_weight_norms_are_known() -> None:
    torch.manual_seed(0)
    layers = [nn.Linear(3, 8), nn.ReLU(), nn.Linear(8, 1)]
    reference = nn.Sequential(
        *(nn.utils.parametrizations.weight_norm(x) if isinstance(x, nn.Linear) else x for x in layers)
    )
    reference.double()
    assert_agree(read(arrays(reference))[0], lambda x: reference(x)[:, 0])


@pytest.mark.parametrize("order", ["hidden_first", "input_first"])
def test_skips_of_both_orders(order: str) -> None:
    torch.manual_seed(0)
    layers = [
        nn.Linear(15, 20).double(),
        nn.Linear(20, 12).double(),
        nn.Linear(27, 9).double(),
        nn.Linear(9, 2).double(),
    ]

    def reference(x: Tensor) -> Tensor:
        entry = encoded(x, 2)
        hidden = torch.relu(layers[1](torch.relu(layers[0](entry))))
        joined = torch.cat([hidden, entry] if order == "hidden_first" else [entry, hidden], dim=1)
        return layers[3](torch.relu(layers[2](joined)))[:, 1]

    named = {f"net.{i}.{k}": v for i, layer in enumerate(layers) for k, v in arrays(layer).items()}
    network, _, notes = read(named, skip_order=order, output_column=1)
    assert "skips at 2" in notes[0]
    assert_agree(network, reference)


@pytest.mark.parametrize(("order", "include"), list(itertools.product(["octave", "axis"], [True, False])))
def test_the_encoding_is_pulled_back_as_autograd_does(order: Any, include: bool) -> None:
    encoding = Encoding(3, include, 2.5, order)
    points = torch.rand(20, 3, dtype=torch.float64, requires_grad=True)
    weights = torch.rand(20, encoding.width, dtype=torch.float64)
    (expected,) = torch.autograd.grad((encoding.encode(points) * weights).sum(), points)
    torch.testing.assert_close(encoding.pull_back(points.detach(), weights), expected)


def test_encodings_by_axis_are_nerfstudios() -> None:
    points = torch.rand(5, 3, dtype=torch.float64)
    angles = (2 * torch.pi * points[..., None] * 2.0 ** torch.arange(2)).reshape(5, 6)
    expected = torch.cat([points, torch.sin(torch.cat([angles, angles + torch.pi / 2], dim=1))], dim=1)
    torch.testing.assert_close(Encoding(2, True, 2 * torch.pi, "axis").encode(points), expected)


@pytest.mark.parametrize(("more", "preset"), [((), "nerfstudio"), (("laplace_density.beta",), "sdfstudio")])
def test_a_field_with_colours_beside_it_is_told_by_its_names(more: tuple[str, ...], preset: str) -> None:
    sizes = [(40, 71), (40, 40), (40, 40), (9, 40), (40, 80), (5, 40)]
    weights = {f"pipeline._model.field.glin{i}.weight": np.ones(size) for i, size in enumerate(sizes)}
    weights |= {f"pipeline._model.field.clin{i}.weight": np.ones(size) for i, size in enumerate([(8, 66), (3, 8)])}
    weights |= {f"pipeline._model.field.{name}": np.ones(1) for name in more}
    _, description, notes = read(weights)
    assert description.preset == preset
    assert description.base_frequency == (1.0 if preset == "sdfstudio" else pytest.approx(2 * np.pi))
    assert any("features of its grid are taken to be zeros" in note for note in notes)


def test_the_distance_of_volsdf_is_taken_not_its_colours() -> None:
    sizes = [(40, 39), (40, 40), (40, 40), (1, 40), (40, 40), (5, 40)]
    weights = {f"model.implicit_network.lin{i}.weight": np.ones(size) for i, size in enumerate(sizes)}
    weights |= {f"model.rendering_network.lin{i}.weight": np.ones(size) for i, size in enumerate([(8, 33), (3, 8)])}
    assert read(weights)[1].preset == "neus"


def test_sdfstudio_inputs_without_grid_features_count_for_nothing() -> None:
    torch.manual_seed(0)
    weights = {
        f"field.glin{i}.weight": np.random.default_rng(i).normal(size=s)
        for i, s in enumerate([(40, 71), (40, 40), (40, 40), (9, 40), (40, 80), (5, 40)])
    }
    full = read(weights, frequencies=6)[0]
    zeroed = dict(weights)
    zeroed["field.glin0.weight"] = weights["field.glin0.weight"].copy()
    zeroed["field.glin0.weight"][:, 39:] = 7.0
    points = torch.rand(10, 3, dtype=torch.float64)
    torch.testing.assert_close(full.value(points), read(zeroed, frequencies=6)[0].value(points))


def test_layers_are_found_transposed_and_in_any_order() -> None:
    reference = Ball().double()
    named = arrays(reference)
    turned = {
        "layer_10/kernel:0": named["layers.2.weight"].T,
        "layer_10/bias:0": named["layers.2.bias"],
        "layer_9/kernel:0": named["layers.0.weight"].T,
        "layer_9/bias:0": named["layers.0.bias"],
    }
    assert_agree(read(turned)[0], reference)
    short = {"A0": turned["layer_9/kernel:0"], "A1": turned["layer_10/kernel:0"], "b1": named["layers.2.bias"]}
    assert_agree(read(short)[0], reference)  # no first bias: zeros


@pytest.mark.parametrize(
    ("named", "options", "words"),
    [
        ({"x": np.zeros(3)}, {}, "no weights of layers"),
        ({"a.weight": np.zeros((4, 3))}, {"prefix": "b"}, "no array's name begins with 'b'"),
        ({"a.0.weight": np.zeros((4, 3)), "a.2.weight": np.zeros((1, 5))}, {}, "need one chain of layers"),
        ({"a.0.weight": np.zeros((4, 3)), "a.0.bias": np.zeros(7)}, {}, "a bias of 7 numbers does not fit"),
        ({"a.0.weight": np.zeros((4, 5)), "a.2.weight": np.zeros((1, 4))}, {}, "takes 5 numbers"),
        ({"a.0.weight": np.zeros((4, 3)), "a.2.weight": np.zeros((1, 4))}, {"output_column": 1}, "has 1 outputs"),
        ({"a.0.weight": np.full((4, 3), np.nan), "a.2.weight": np.zeros((1, 4))}, {}, "not finite"),
        ({"0001.gelu._": np.zeros(0), "0.dense.A": np.zeros((3, 4)), "2.dense.A": np.zeros((4, 1))}, {}, "gelu"),
        (
            {f"{n}.{i}.weight": np.zeros(s) for n in "ab" for i, s in enumerate([(4, 3), (1, 4)])},
            {},
            "say which with --network.prefix",
        ),
    ],
)
def test_what_is_no_network_of_points_is_said(named: dict[str, np.ndarray], options: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(named, **options)
