"""Losses of learned fields and their gradients with respect to the network's outputs (Sec. 3.5)."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.config.field import FieldConfig

Loss = Callable[[Tensor, Tensor], tuple[float, Tensor]]
"""(outputs, targets), both (k, n, o), to the mean loss and its gradient."""


def squared_error(
    outputs: Float[Tensor, "k n o"], targets: Float[Tensor, "k n o"]
) -> tuple[float, Float[Tensor, "k n o"]]:
    """Mean of the squared difference."""
    residual = outputs - targets
    return float(residual.square().mean()), residual.mul_(2 / residual.numel())


def absolute_error(
    outputs: Float[Tensor, "k n o"], targets: Float[Tensor, "k n o"]
) -> tuple[float, Float[Tensor, "k n o"]]:
    """Mean of the absolute difference, whose least value is at the median."""
    residual = outputs - targets
    return float(residual.abs().mean()), residual.sign_().div_(residual.numel())


def binary_cross_entropy(
    outputs: Float[Tensor, "k n o"], targets: Float[Tensor, "k n o"]
) -> tuple[float, Float[Tensor, "k n o"]]:
    """Mean of -y ln s(x) - (1 - y) ln(1 - s(x)) with the logistic s. Sec. 3.5 prints it without its minus sign."""
    loss = torch.nn.functional.softplus(outputs) - targets * outputs
    return float(loss.mean()), torch.sigmoid(outputs).sub_(targets).div_(outputs.numel())


def cross_entropy(
    outputs: Float[Tensor, "k n o"], targets: Float[Tensor, "k n o"]
) -> tuple[float, Float[Tensor, "k n o"]]:
    """Mean of -ln softmax(x) at the true class; `targets` are one in its column and zero elsewhere."""
    logarithm = torch.log_softmax(outputs, dim=2)
    count = outputs.shape[0] * outputs.shape[1]
    return float(-(logarithm * targets).sum() / count), logarithm.exp_().sub_(targets).div_(count)


def loss_of(config: FieldConfig) -> Loss:
    """The loss that a field is learned with."""
    if config.kind == "binary":
        return binary_cross_entropy
    if config.kind == "categorical":
        return cross_entropy
    return absolute_error if config.loss == "absolute" else squared_error
