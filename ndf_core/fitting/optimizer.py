"""Adam on the flat parameter vector, and Muon for the hidden matrices; both with their state as plain tensors."""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.fitting.network import Parameters


@runtime_checkable
class Rates(Protocol):
    """The options that updates depend on; `FitConfig` and `FieldConfig` have them."""

    @property
    def optimizer(self) -> str: ...

    @property
    def learning_rate(self) -> float: ...

    @property
    def feature_learning_rate(self) -> float: ...

    @property
    def adam_beta2(self) -> float: ...

    @property
    def schedule(self) -> str: ...

    @property
    def warmup_steps(self) -> int: ...

    @property
    def steps(self) -> int: ...


class Optimizer:
    """One update rule for all parameters. `state` is everything a checkpoint needs, by name."""

    def __init__(self, parameters: Parameters, config: Rates) -> None:
        self._parameters = parameters
        self._config = config
        shape, device = parameters.shape, parameters.flat.device
        self._rates = Parameters.zeros(shape, device)
        self._rates.flat.fill_(config.learning_rate)
        self._rates.features.fill_(config.feature_learning_rate)
        self._first = Parameters.zeros(shape, device)
        self._second = Parameters.zeros(shape, device)
        self._count = 0
        hidden = [f"{name}.weight.{i}" for name in shape.networks for i in range(shape.hidden_layers)]
        self._orthogonal = hidden if config.optimizer == "muon" else []
        for name in self._orthogonal:
            self._rates.views[name].zero_()  # Adam leaves these alone

    @property
    def state(self) -> dict[str, Tensor]:
        """Moments and step count; `load_state` takes the same."""
        return {
            "adam.first": self._first.flat,
            "adam.second": self._second.flat,
            "adam.count": torch.tensor(self._count),
        }

    def load_state(self, state: dict[str, Tensor]) -> None:
        self._first.flat.copy_(state["adam.first"])
        self._second.flat.copy_(state["adam.second"])
        self._count = int(state["adam.count"])

    def step(self, gradient: Parameters, factor: float) -> None:
        """Update in place with the learning rates times `factor`.

        Reference: Adam, Kingma and Ba 2015; Muon, Jordan et al. 2024 (momentum, then an orthogonalised update).
        """
        self._count += 1
        beta1, beta2 = 0.9, self._config.adam_beta2
        self._first.flat.lerp_(gradient.flat, 1 - beta1)
        self._second.flat.mul_(beta2).addcmul_(gradient.flat, gradient.flat, value=1 - beta2)
        root = self._second.flat.sqrt().div_(math.sqrt(1 - beta2**self._count)).add_(1e-8)
        update = (self._first.flat * self._rates.flat).div_(root)
        self._parameters.flat.add_(update, alpha=-factor / (1 - beta1**self._count))
        for name in self._orthogonal:
            # Nesterov momentum on Adam's own first moment, so that Muon keeps no state besides.
            direction = orthogonalise(gradient.views[name].lerp(self._first.views[name], beta1))
            tall = math.sqrt(max(1.0, direction.shape[0] / direction.shape[1]))
            self._parameters.views[name].add_(direction, alpha=-2 * factor * self._config.learning_rate * tall)


def orthogonalise(matrix: Float[Tensor, "m n"], iterations: int = 3) -> Float[Tensor, "m n"]:
    """Nearest semi-orthogonal matrix, roughly: all but the smallest singular values are driven into about [0.7, 1.2].

    Three iterations leave singular values below about a hundredth of the largest behind; five, as Muon takes, would
    bring those up as well, which costs more and fits no better here.

    Reference: the quintic Newton-Schulz iteration of Muon (Jordan et al. 2024).
    """
    wide = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.t()
    x = wide / wide.norm().clamp_min(1e-20)
    for _ in range(iterations):
        gram = x @ x.t()
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=-4.7750, alpha=2.0315), x, beta=3.4445)
    return x if wide is matrix else x.t()


def rate_factor(config: Rates, step: int) -> float:
    """Learning rate at `step` (from 0) as a share of its peak."""
    rise = min(1.0, (step + 1) / config.warmup_steps) if config.warmup_steps else 1.0
    if config.schedule == "constant":
        return rise
    return rise * 0.5 * (1 + math.cos(math.pi * step / max(config.steps, 1)))
