"""Activations with their derivatives, as fused operations on whole blocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from ndf_plugin_sdf.networks.description import NetworkDescription

_aten = torch.ops.aten
_LINEAR_ABOVE = 20.0
"""softplus(x) = x above this, relative to beta, as torch and NeuS compute it."""


@dataclass(frozen=True)
class Activation:
    """A function of each number and its derivative."""

    forward: Callable[[Float[Tensor, "n w"]], Float[Tensor, "n w"]]
    """Of what a layer computes; may overwrite its argument unless `keeps_input`."""
    backward: Callable[[Float[Tensor, "n w"], Float[Tensor, "n w"]], Float[Tensor, "n w"]]
    """(gradient after, input or output) -> gradient before."""
    keeps_input: bool
    """Whether `backward` wants the function's input; its output otherwise."""


def activation(description: NetworkDescription) -> Activation:
    """The function that a description means; a sine's omega is taken to be in the weights."""
    beta, slope = description.beta, description.slope
    match description.activation:
        case "elu":
            return Activation(functional.elu_, lambda g, y: _aten.elu_backward(g, 1.0, 1.0, 1.0, True, y), False)
        case "leaky_relu":
            return Activation(
                lambda x: functional.leaky_relu_(x, slope),
                lambda g, y: _aten.leaky_relu_backward(g, y, slope, True),
                False,
            )
        case "tanh":
            return Activation(torch.tanh_, _aten.tanh_backward, False)
        case "softplus":
            return Activation(
                lambda x: functional.softplus(x, beta, _LINEAR_ABOVE),
                lambda g, x: _aten.softplus_backward(g, x, beta, _LINEAR_ABOVE),
                True,
            )
        case "sine":
            return Activation(torch.sin, lambda g, x: torch.cos(x).mul_(g), True)
        case _:
            return Activation(torch.relu_, lambda g, y: _aten.threshold_backward(g, y, 0.0), False)
