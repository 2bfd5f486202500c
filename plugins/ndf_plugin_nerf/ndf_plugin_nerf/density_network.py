"""The part of a NeRF's network that gives the density: encoding, trunk, one output. No colours, no directions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_plugin_nerf.density import Density
from ndf_plugin_nerf.families import Named

_TILE = 2048
"""Points whose activations stay in a core's cache: 1 MiB at a width of 128."""
_WIDEST, _DEEPEST, _MOST_OCTAVES = 4096, 64, 24


@dataclass(frozen=True)
class Dense:
    """x -> W x + b, then perhaps ReLU; for a skip connection, x is the hidden units and then the encoded point."""

    weight: Float[Tensor, "out in"]
    bias: Float[Tensor, " out"]
    relu: bool
    skip: bool


class DensityNetwork(Density):
    """sigma(x) of a vanilla NeRF in float32, as it was trained.

    Reference: Mildenhall et al. 2020, Sec. 5.1 and App. A.
    """

    def __init__(self, layers: tuple[Dense, ...], octaves: int, include_input: bool, bounds: Box) -> None:
        """Take the layers, the last one with a single output; see `assemble`."""
        self.layers, self.octaves, self.include_input, self.bounds = layers, octaves, include_input, bounds

    @property
    def description(self) -> str:
        """One line for the user."""
        skips = [str(i) for i, layer in enumerate(self.layers) if layer.skip]
        joined = f", the point again before layer {', '.join(skips)}" if skips else ""
        width = len(self.layers[0].bias)
        return f"{len(self.layers) - 1} layers of {width} units, {self.octaves} octaves{joined}"

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        single = points.to(torch.float32)
        return torch.cat([self._tile(tile) for tile in single.split(_TILE)]) if len(single) else single[:, 0]

    def _tile(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        encoded = self._encoded(points)
        hidden = encoded
        for layer in self.layers:
            inputs = torch.cat([hidden, encoded], dim=1) if layer.skip else hidden
            hidden = torch.addmm(layer.bias, inputs, layer.weight.t())
            if layer.relu:
                hidden.relu_()
        return hidden[:, 0]

    def _encoded(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n e"]:
        """The point, then all sines, then all cosines, each octave by octave: `assemble` sorts the weights so."""
        angles = (points[:, None, :] * 2.0 ** torch.arange(self.octaves)[:, None]).flatten(1)
        waves = [angles.sin(), angles.cos()]
        return torch.cat([points, *waves] if self.include_input else waves, dim=1)


def assemble(arrays: Mapping[str, Array], named: Named, bounds: Box) -> DensityNetwork:
    """The density network that `named` points to among the arrays of a file.

    Args:
        arrays: by name.
        named: from `families.networks`.
        bounds: where the density means something.

    Raises:
        InputError: layers are missing, do not fit each other, or hold numbers that are not finite.
    """
    family, prefix = named.family, named.prefix
    names = _trunk(arrays, named)
    matrices = [_layer(arrays, prefix + name) for name in [*names, named.density]]
    encoded = matrices[0][0].shape[1]
    octaves, rest = divmod(encoded, 6)
    if rest not in (0, 3) or not 0 < octaves <= _MOST_OCTAVES:
        raise InputError(
            f"{prefix}{names[0]} takes {encoded} numbers, which are no point (3) with some octaves of sin and cos (6 "
            "each): its encoding is not that of a vanilla NeRF"
        )
    if named.row >= len(matrices[-1][0]):
        raise InputError(
            f"{prefix}{named.density} has {len(matrices[-1][0])} outputs; its density would be {named.row}"
        )
    order = _octave_order(octaves, rest)
    layers: list[Dense] = []
    width = 0
    for index, (weight, bias) in enumerate(matrices):
        last = index == len(names)
        skip = index > 0 and weight.shape[1] == width + encoded
        if index > 0 and not skip and weight.shape[1] != width:
            raise InputError(f"{prefix}{[*names, named.density][index]} takes {weight.shape[1]} numbers, not {width}")
        if skip and family.skip_order == "input_first":
            weight = np.concatenate([weight[:, encoded:], weight[:, :encoded]], axis=1)
        if skip or index == 0:
            weight = np.concatenate(
                [weight[:, : -encoded or None] if skip else weight[:, :0], weight[:, -encoded:][:, order]], axis=1
            )
        if last:
            weight, bias = weight[named.row : named.row + 1], bias[named.row : named.row + 1]
        relu = not last and not (index == 0 and family.first is not None)
        layers.append(Dense(_tensor(weight), _tensor(bias), relu, skip))
        width = len(bias)
    return DensityNetwork(tuple(layers), octaves, rest == 3, bounds)


def _trunk(arrays: Mapping[str, Array], named: Named) -> list[str]:
    """Names of the trunk's layers in order, without the prefix."""
    family = named.family
    numbers = sorted(
        int(found[1])
        for name in arrays
        if name.startswith(named.prefix)
        and (found := re.fullmatch(rf"{family.trunk}\.weight", name.removeprefix(named.prefix))) is not None
    )
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))) or numbers[0] > 1 or len(numbers) > _DEEPEST:
        raise InputError(f"{named.prefix or 'the file'}: its trunk has layers {numbers[:12]}: some are missing")
    pattern = family.trunk.replace(r"(\d+)", "{}").replace("\\", "")
    return [*([family.first] if family.first else []), *(pattern.format(number) for number in numbers)]


def _layer(arrays: Mapping[str, Array], name: str) -> tuple[Float[Array, "out in"], Float[Array, " out"]]:
    weight = arrays[f"{name}.weight"]
    bias = arrays.get(f"{name}.bias", np.zeros(len(weight) if weight.ndim else 0, np.float32))
    if (
        weight.ndim != 2
        or bias.shape != (len(weight),)
        or not 0 < weight.shape[0] <= _WIDEST
        or weight.shape[1] > _WIDEST
    ):
        raise InputError(f"{name}: weights {weight.shape} and biases {bias.shape} are no layer of a vanilla NeRF")
    if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
        raise InputError(f"{name}: has weights that are not finite numbers")
    return weight.astype(np.float32), bias.astype(np.float32)


def _octave_order(octaves: int, first: int) -> list[int]:
    """Columns of (point, sin and cos octave by octave) in the order (point, all sines, all cosines)."""
    waves = [
        [first + 6 * octave + 3 * kind + axis for octave in range(octaves) for axis in range(3)] for kind in (0, 1)
    ]
    return [*range(first), *waves[0], *waves[1]]


def _tensor(array: Float[Array, "..."]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))
