"""A multilayer perceptron with one output: value and gradient of whole blocks, without an autograd graph."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_plugin_sdf.networks.activations import Activation
from ndf_plugin_sdf.networks.encoding import Encoding


@dataclass(frozen=True)
class Dense:
    """One layer: x -> activation(W x + b)."""

    weight: Float[Tensor, "out in"]
    bias: Float[Tensor, " out"]
    activation: Activation | None
    """None for the last layer."""
    skip: bool = False
    """Whether its input is the hidden units and then the encoded point."""


@dataclass(frozen=True)
class Mlp:
    """phi(x) of points in the network's own units."""

    layers: tuple[Dense, ...]
    encoding: Encoding

    def to(self, device: torch.device, dtype: torch.dtype) -> Mlp:
        """A copy with its weights there."""
        moved = tuple(
            replace(layer, weight=layer.weight.to(device, dtype), bias=layer.bias.to(device, dtype))
            for layer in self.layers
        )
        return replace(self, layers=moved)

    def value(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """phi, in the dtype and on the device of points and weights alike."""
        encoded = self.encoding.encode(points)
        hidden = encoded
        for layer in self.layers:
            hidden = torch.addmm(layer.bias, _input(layer, hidden, encoded), layer.weight.T)
            if layer.activation is not None:
                hidden = layer.activation.forward(hidden)
        return hidden[:, 0]

    def value_and_gradient(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        """phi and its gradient: the layers forwards, and their transposes backwards."""
        encoded = self.encoding.encode(points)
        hidden = encoded
        kept: list[Tensor] = []
        for layer in self.layers:
            hidden = torch.addmm(layer.bias, _input(layer, hidden, encoded), layer.weight.T)
            if layer.activation is not None:
                before, hidden = hidden, layer.activation.forward(hidden)
                kept.append(before if layer.activation.keeps_input else hidden)
        gradient = self.layers[-1].weight.expand(len(points), -1)
        skipped = torch.zeros_like(encoded)
        for layer, previous in zip(self.layers[:0:-1], self.layers[-2::-1], strict=True):
            if layer.skip:
                skipped = skipped + gradient[:, -encoded.shape[1] :]
                gradient = gradient[:, : -encoded.shape[1]]
            assert previous.activation is not None  # only the last layer has none
            gradient = previous.activation.backward(gradient, kept.pop()) @ previous.weight
        return hidden[:, 0], self.encoding.pull_back(points, gradient + skipped)


def _input(layer: Dense, hidden: Float[Tensor, "n w"], encoded: Float[Tensor, "n e"]) -> Float[Tensor, "n v"]:
    return torch.cat([hidden, encoded], dim=1) if layer.skip else hidden
