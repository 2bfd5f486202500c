"""The networks of a fit, and the flat vector that holds all of their parameters (Sec. 3.3)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ndf_core.asset.content import Encoding


@dataclass(frozen=True)
class NetworkShape:
    """Sizes that the networks share, and what the forward one sees beside the encoding.

    A displacement has a forward network and its inverse; a learned field (Sec. 3.5) has a forward one alone.
    """

    encoding: Encoding
    hidden_width: int
    hidden_layers: int
    vertex_count: int
    feature_dim: int
    outputs: int = 3
    networks: tuple[str, ...] = ("forward", "inverse")
    latent: tuple[int, int] = (0, 0)
    """Number of latent codes, and numbers in each; the forward network sees one beside the features."""

    def layer_sizes(self, feature_dim: int) -> list[tuple[int, int]]:
        """(out, in) of each layer of a network that sees `feature_dim` numbers beside the encoding."""
        widths = [self.encoding.width + feature_dim, *[self.hidden_width] * self.hidden_layers, self.outputs]
        return [(out, into) for into, out in itertools.pairwise(widths)]

    def parameter_shapes(self) -> dict[str, tuple[int, ...]]:
        """Name and shape of every tensor, in the order of the flat vector."""
        shapes: dict[str, tuple[int, ...]] = {"features": (self.vertex_count, self.feature_dim)}
        if self.latent[0]:
            shapes["latent"] = self.latent
        for network in self.networks:
            beside = self.feature_dim + self.latent[1] if network == "forward" else 0
            for i, (out, into) in enumerate(self.layer_sizes(beside)):
                shapes[f"{network}.weight.{i}"] = (out, into)
                shapes[f"{network}.bias.{i}"] = (out,)
        return shapes


class Parameters:
    """All parameters as views into one flat float32 vector, so that an optimiser step is a few large operations."""

    def __init__(self, shape: NetworkShape, flat: Float[Tensor, " p"]) -> None:
        self.shape = shape
        self.flat = flat
        self.views: dict[str, Tensor] = {}
        start = 0
        for name, size in shape.parameter_shapes().items():
            count = math.prod(size)
            self.views[name] = flat[start : start + count].view(size)
            start += count
        if start != flat.numel():
            raise ValueError(f"the flat vector holds {flat.numel()} numbers, the network has {start}")

    @classmethod
    def zeros(cls, shape: NetworkShape, device: torch.device | str = "cpu") -> Parameters:
        """All parameters (or gradients) zero."""
        count = sum(math.prod(size) for size in shape.parameter_shapes().values())
        return cls(shape, torch.zeros(count, device=device))

    @classmethod
    def initial(
        cls,
        shape: NetworkShape,
        seed: int,
        *,
        zero_last: bool,
        feature_scale: float,
        device: torch.device | str = "cpu",
    ) -> Parameters:
        """Kaiming-uniform weights and biases as torch's `Linear` draws them, normal features and latent codes.

        With `zero_last` the last layers are zero, so that both networks are the identity from the first step on
        (the residual form y = x + mlp makes that exact), which the paper trains 1,000 epochs for. `feature_scale` is
        the standard deviation of the features.

        Reference: App. A.1. Of the two usual readings of "Kaiming initialization", the gain of `Linear` (a = sqrt 5)
        starts smoother and ends at half the error of the gain for ReLU.
        """
        generator = torch.Generator().manual_seed(seed)
        parameters = cls.zeros(shape)
        for name, view in parameters.views.items():
            if "." not in name:
                scale = feature_scale if name == "features" else 1.0
                view.copy_(torch.randn(view.shape, generator=generator) * scale)
                continue
            network, _, index = name.split(".")
            fan_in = parameters.views[f"{network}.weight.{index}"].shape[1]
            view.copy_((torch.rand(view.shape, generator=generator) * 2 - 1) / math.sqrt(fan_in))
            if zero_last and int(index) == shape.hidden_layers:
                view.zero_()
        return cls(shape, parameters.flat.to(device))

    def damp_octaves(self, factor: float) -> None:
        """Lower the forward network's weights from octave k of the encoding by factor^k.

        At full weight the high octaves are noise that the first steps have to unlearn.
        """
        first, encoding = self.views["forward.weight.0"], self.shape.encoding
        start = encoding.width - 6 * encoding.levels
        for level in range(encoding.levels):
            first[:, start + 6 * level : start + 6 * level + 6] *= factor**level

    def layers(self, network: str) -> list[tuple[Tensor, Tensor]]:
        """(weight, bias) of each layer of "forward" or "inverse"."""
        count = self.shape.hidden_layers + 1
        return [(self.views[f"{network}.weight.{i}"], self.views[f"{network}.bias.{i}"]) for i in range(count)]

    @property
    def features(self) -> Float[Tensor, "v d"]:
        return self.views["features"]


def frequency_matrix(encoding: Encoding, device: torch.device | str = "cpu") -> tuple[Tensor, Tensor]:
    """(matrix (3, 6 levels), phase (6 levels,)) with sin(x @ matrix + phase) the periodic part of the encoding.

    cos(a) = sin(a + pi/2), so that one sine over one contiguous block evaluates everything.
    """
    matrix = torch.zeros(3, 6 * encoding.levels, dtype=torch.float64)
    phase = torch.zeros(6 * encoding.levels, dtype=torch.float64)
    for level in range(encoding.levels):
        frequency = encoding.base_frequency * 2.0**level
        for axis in range(3):
            matrix[axis, 6 * level + axis] = frequency
            matrix[axis, 6 * level + 3 + axis] = frequency
            phase[6 * level + 3 + axis] = math.pi / 2
    return matrix.to(device, torch.float32), phase.to(device, torch.float32)


def encode(points: Float[Tensor, "*n 3"], encoding: Encoding) -> Float[Tensor, "*n e"]:
    """Periodic encoding of box-frame points, in the column order of `Encoding`. Differentiable."""
    matrix, phase = frequency_matrix(encoding, points.device)
    waves = torch.sin(points @ matrix.to(points.dtype) + phase.to(points.dtype))
    return torch.cat([points, waves], dim=-1) if encoding.include_position else waves


def interpolate(
    values: Float[Tensor, "v k"], corners: Int[Tensor, "n 3"], barycentric: Float[Tensor, "n 3"]
) -> Tensor:
    """Barycentric mean of per-vertex values at base points; `corners` are the vertex indices of their faces."""
    return (values[corners] * barycentric[..., None]).sum(dim=-2)


def apply_network(layers: list[tuple[Tensor, Tensor]], inputs: Float[Tensor, "*n i"]) -> Float[Tensor, "*n o"]:
    """Fully connected layers with ReLU between them. The readable reference of `step.FusedStep`. Differentiable."""
    for index, (weight, bias) in enumerate(layers):
        inputs = torch.nn.functional.linear(inputs, weight, bias)
        if index + 1 < len(layers):
            inputs = torch.relu(inputs)
    return inputs


def displace(
    parameters: Parameters,
    positions: Float[Tensor, "n 3"],
    features: Float[Tensor, "n d"],
) -> Float[Tensor, "n 3"]:
    """g(x) = x + mlp([encoding(x), features(x)]), box frame (Sec. 3.3)."""
    inputs = torch.cat([encode(positions, parameters.shape.encoding), features], dim=-1)
    return positions + apply_network(parameters.layers("forward"), inputs)


def invert(parameters: Parameters, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    """The inverse network: from a mapped point back to its base point, box frame (Sec. 3.2)."""
    return points + apply_network(parameters.layers("inverse"), encode(points, parameters.shape.encoding))
