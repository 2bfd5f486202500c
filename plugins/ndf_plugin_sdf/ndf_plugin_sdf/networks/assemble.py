"""A chain of layers and a description to a network that can be evaluated."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_plugin_sdf.networks.activations import activation
from ndf_plugin_sdf.networks.chain import Chain
from ndf_plugin_sdf.networks.description import FIELD_PRESETS, NetworkDescription
from ndf_plugin_sdf.networks.encoding import Encoding
from ndf_plugin_sdf.networks.mlp import Dense, Mlp


def assemble(chain: Chain, description: NetworkDescription) -> Mlp:
    """The network, in float64. Its input is `input_scale` * (point - `input_offset`).

    What does not change the function is folded into the weights: the order and the scale of skip connections, the
    omega of sines, and the outputs that are not phi.

    Raises:
        InputError: the description does not fit the weights.
    """
    encoding = _encoding(chain, description)
    width, last = chain.input_width, len(chain.layers) - 1
    layers: list[Dense] = []
    for index, layer in enumerate(chain.layers):
        weight, bias = layer.weight, layer.bias
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise InputError(f"layer {layer.name!r} has weights that are not finite")
        skip = index in chain.skips
        if skip:
            if description.skip_order == "input_first":
                weight = np.concatenate([weight[:, width:], weight[:, :width]], axis=1)
            weight = weight * description.skip_scale
        if skip or index == 0:
            weight = weight[:, : weight.shape[1] - (width - encoding.width)]
        if index == last:
            weight, bias = (_column(part, description.output_column) for part in (weight, bias))
        elif description.activation == "sine":
            omega = (description.first_omega if index == 0 else None) or description.omega
            weight, bias = weight * omega, bias * omega
        layers.append(
            Dense(
                torch.from_numpy(np.ascontiguousarray(weight, np.float64)),
                torch.from_numpy(np.ascontiguousarray(bias, np.float64)),
                None if index == last else activation(description),
                skip,
            )
        )
    return Mlp(tuple(layers), encoding)


def _encoding(chain: Chain, description: NetworkDescription) -> Encoding:
    """3 numbers are a point, 3 + 6 f a point and f octaves, 6 f octaves alone.

    SDFStudio and nerfstudio append the features of a grid, zeros where there is none: they count for nothing.
    """
    width = chain.input_width
    octaves = description.frequencies
    if octaves is None:
        if description.preset in FIELD_PRESETS:
            octaves = min(6, (width - 3) // 6)
        else:
            octaves = (width - 3) // 6 if width % 6 == 3 else width // 6
    own = 6 * octaves + (0 if width == 6 * octaves else 3)
    if width != own and not (description.preset in FIELD_PRESETS and width > own):
        raise InputError(
            f"layer {chain.layers[0].name!r} takes {width} numbers, which is no point (3) with an encoding of "
            f"{octaves} octaves (6 each); this is a network of something else, or one with a latent code"
        )
    return Encoding(octaves, own != 6 * octaves, description.base_frequency, description.encoding_order)


def _column(part: Float[Array, "..."], column: int) -> Float[Array, "..."]:
    if column >= len(part):
        raise InputError(f"the network has {len(part)} outputs; --network.output-column {column} is not one of them")
    return part[column : column + 1]
