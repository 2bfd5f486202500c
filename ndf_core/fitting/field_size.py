"""Bring a learned field to a size in bytes: rounding that weighs what a number costs against what it is good for.

Rounding each number to its closest code ignores both. Here features are rounded one after another to the code that
lowers error + price * bits, given all others; then the network is trained on with the rounded numbers, and so on in
turns, while the price is led to the size. The file's format does not know of it.

Reference: rate-distortion optimised quantisation, Sullivan and Wiegand, Signal Processing Magazine 1998; gradients
through rounding as if it were not there, Bengio et al. 2013.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ndf_core.config.field import FieldConfig
from ndf_core.errors import ConfigError
from ndf_core.fitting.field_losses import loss_of
from ndf_core.fitting.field_samples import FieldSamples
from ndf_core.fitting.field_step import FieldStep
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import Parameters, encode, interpolate
from ndf_core.fitting.optimizer import Optimizer, rate_factor
from ndf_core.fitting.quantise import Grids, coarsest, rounded, stored
from ndf_core.fitting.sampling import generator_at
from ndf_core.kernels.codes import encode_codes

_START = 1.06
"""Size of the plainly rounded numbers that the search starts from, over the size asked for."""
_NETWORK = 0.6
"""Steps of the network's numbers, over those at which they add as much error as features do. Features make up for
roundings around them, and so for the network's too; the other way round it is slow."""
_FIRST_PRICE = 0.6
"""Over what finer grids cost for the same: a code that is moved saves less than the next grid does."""
_ROUNDS = 10
_SWEEPS = 1
_POLISHING = 0.125
"""Training steps of the network between two rounds, as a share of the field's own."""
_POLISHING_RATE = 0.5
"""Learning rate of those, as a share of the field's own."""
_SEEN = 2**18
"""Samples that features are rounded by."""
_LEAST_MEAN = 1 / 8
"""Mean magnitude of a column's codes that the coder's model assumes at least."""
_ATTEMPTS = 40
"""How often grids may get coarser where the size is still too large at the end."""


@dataclass(frozen=True)
class Standard:
    """Mean 0 and variance 1: what losses and learning rates are for. value = shift + scale * output."""

    shift: Float[Tensor, " o"]
    scale: Float[Tensor, " o"]

    def to_values(self, parameters: Parameters) -> None:
        """Make the last layer give the values themselves, in place."""
        weight, bias = parameters.layers("forward")[-1]
        weight.mul_(self.scale[:, None])
        bias.mul_(self.scale).add_(self.shift)

    def from_values(self, parameters: Parameters) -> None:
        """The inverse of `to_values`."""
        weight, bias = parameters.layers("forward")[-1]
        weight.div_(self.scale[:, None])
        bias.sub_(self.shift).div_(self.scale)


def fit_to_size(
    parameters: Parameters,
    standard: Standard,
    sensitivity: dict[str, float],
    geometry: BaseGeometry,
    samples: FieldSamples,
    config: FieldConfig,
) -> Grids:
    """Change features and network, in place, so that their codes take at most `config.size` bytes at little error.

    Args:
        parameters: trained on `samples`, features in canonical form; they give values.
        standard: what the loss is taken in.
        sensitivity: of the standard outputs to each tensor (`quantise.sensitivities`).
        samples: one field, targets in units of the values.

    Returns:
        The grids that the parameters are to be stored on.

    Raises:
        ConfigError: not even the coarsest grids are so small.
    """
    samples = _some(samples)
    finer = {name: value if name == "features" else value / _NETWORK for name, value in sensitivity.items()}
    grids = coarsest(parameters, finer, lambda _, now: coded_size(parameters, now) >= _START * config.size)
    search = FeatureSearch(geometry, samples, standard, config)
    price = _FIRST_PRICE * _slope(parameters, grids, search)
    parameters.features.copy_(rounded(parameters, grids).features)
    kept, error, size = parameters.flat.clone(), math.inf, coded_size(parameters, grids)
    for number in range(_ROUNDS):
        if number:
            _polish(parameters, standard, grids, geometry, samples, config, number)
        search.run(parameters, grids, price, _SWEEPS)
        new_error, new_size = search.error(rounded(parameters, grids)), coded_size(parameters, grids)
        if new_error + 8 * price * new_size < error + 8 * price * size:
            kept.copy_(parameters.flat)
            error, size = new_error, new_size
        else:
            parameters.flat.copy_(kept)
        price *= (size / config.size) ** 3
    for attempt in range(_ATTEMPTS):
        if coded_size(parameters, grids) <= config.size:
            return grids
        grids = {name: float(np.float32(step * 1.02**attempt)) for name, step in grids.items()}
        parameters.features.copy_(rounded(parameters, grids).features)
        search.run(parameters, grids, price, 1)
    raise ConfigError(f"size: this field does not fit into {config.size} bytes; ask for more")


def coded_size(parameters: Parameters, grids: Grids) -> int:
    """Bytes of all numbers on these grids, as the file codes them."""
    codes = [stored(parameters, name, step).codes for name, step in grids.items()]
    return len(encode_codes([array if array.ndim == 2 else array[:, None] for array in codes]))


def _some(samples: FieldSamples) -> FieldSamples:
    """At most `_SEEN` of them, evenly."""
    if len(samples) <= _SEEN:
        return samples
    rows = torch.arange(_SEEN) * len(samples) // _SEEN
    return replace(
        samples, faces=samples.faces[rows], barycentric=samples.barycentric[rows], targets=samples.targets[rows]
    )


def _slope(parameters: Parameters, grids: Grids, search: FeatureSearch) -> float:
    """Error that a bit saves where grids get finer: what the first round pays for a bit."""
    coarser = {name: 1.25 * step for name, step in grids.items()}
    lost = search.error(rounded(parameters, coarser)) - search.error(rounded(parameters, grids))
    saved = 8 * (coded_size(parameters, grids) - coded_size(parameters, coarser))
    return max(lost, 1e-9) / max(saved, 1)


def _polish(
    parameters: Parameters,
    standard: Standard,
    grids: Grids,
    geometry: BaseGeometry,
    samples: FieldSamples,
    config: FieldConfig,
    number: int,
) -> None:
    """Train the network on, as it is when rounded; features stay."""
    steps = max(1, round(_POLISHING * config.steps))
    config = config.model_copy(update={"steps": steps, "learning_rate": _POLISHING_RATE * config.learning_rate})
    count = min(config.batch, len(samples))
    standard.from_values(parameters)
    optimizer, loss_function = Optimizer(parameters, config), loss_of(config)
    gradient = Parameters.zeros(parameters.shape, geometry.device)
    step = FieldStep(parameters.shape, count, geometry.device, gradient)
    grids = {name: width for name, width in grids.items() if name != "features"}  # those are rounded already
    for index in range(steps):
        base, targets = samples.batch(geometry, count, generator_at(config.seed, number * 2**32 + index))
        values = Parameters(parameters.shape, parameters.flat.clone())
        standard.to_values(values)
        values = rounded(values, grids)
        outputs = (step.evaluate(values, base.batch) - standard.shift) / standard.scale
        _, into_outputs = loss_function(outputs, (targets - standard.shift) / standard.scale)
        gradient.flat.zero_()
        step.backward(values, base.batch, into_outputs / standard.scale)
        for into_last in gradient.layers("forward")[-1]:
            into_last.mul_(standard.scale.view(-1, *[1] * (into_last.ndim - 1)))
        gradient.features.zero_()
        optimizer.step(gradient, rate_factor(config, index))
    standard.to_values(parameters)


class FeatureSearch:
    """Rounds features one after another, those of vertices that share no face at once."""

    def __init__(
        self, geometry: BaseGeometry, samples: FieldSamples, standard: Standard, config: FieldConfig
    ) -> None:
        base, targets = samples.rows(geometry, torch.arange(len(samples), device=samples.faces.device))
        self._base, self._targets = base, targets[0]
        self._scale, self._absolute = standard.scale, config.loss == "absolute"
        self._sets = list(independent_sets(geometry.faces, len(geometry.vertices)))

    def error(self, parameters: Parameters) -> float:
        """Mean loss."""
        features = interpolate(parameters.features, self._base.batch.corners, self._base.barycentric)
        rest = _Rest(parameters)
        before = rest.without_features(self._base.batch.positions) + features @ rest.columns.mT
        return float(self._errors(rest, before, self._targets).sum()) / self._targets.numel()

    def run(self, parameters: Parameters, grids: Grids, price: float, sweeps: int) -> None:
        """Change features in place; they are on their grid already."""
        if "features" not in grids:
            return  # a field without any
        step = grids["features"]
        codes = torch.round(parameters.features / step).long()
        rest = _Rest(rounded(parameters, grids))
        fixed = rest.without_features(self._base.batch.positions)
        for _ in range(sweeps):
            for chosen in self._sets:
                self._improve(codes, chosen, step, price, rest, fixed)
        parameters.features.copy_(codes * step)

    def _improve(
        self,
        codes: Int[Tensor, "v d"],
        chosen: Bool[Tensor, " v"],
        step: float,
        price: float,
        rest: _Rest,
        fixed: Float[Tensor, "n h"],
    ) -> None:
        """For each chosen vertex, the one change of a code by one that gains most, if any does."""
        corners, barycentric = self._base.batch.corners, self._base.barycentric
        touched = chosen[corners]
        rows = touched.any(1).nonzero()[:, 0]
        corner = touched[rows].int().argmax(1)
        vertex, weight = corners[rows, corner], barycentric[rows, corner]
        targets = self._targets[rows]
        features = interpolate(codes * step, corners[rows], barycentric[rows])
        before = fixed[rows] + features @ rest.columns.mT
        now = self._errors(rest, before, targets)
        best = torch.zeros(len(codes), device=codes.device)
        change = torch.zeros_like(codes)
        for column in range(codes.shape[1]):
            bits = code_bits(codes[:, column])
            direction = weight[:, None] * (step * rest.columns[:, column])
            for sign in (-1, 1):
                gain = now - self._errors(rest, before + sign * direction, targets)
                gains = torch.zeros_like(best).index_add_(0, vertex, gain).div_(self._targets.numel())
                gains -= price * (bits(codes[:, column] + sign) - bits(codes[:, column]))
                better = chosen & (gains > best)
                best = torch.where(better, gains, best)
                change[better] = 0
                change[better, column] = sign
        codes += change

    def _errors(
        self, rest: _Rest, before: Float[Tensor, "n h"], targets: Float[Tensor, "n o"]
    ) -> Float[Tensor, " n"]:
        """Loss of each point, summed over its outputs, from what enters the first layer's activation."""
        residual = (rest.after(before) - targets) / self._scale
        return (residual.abs_() if self._absolute else residual.square_()).sum(1)


class _Rest:
    """A network taken apart where features enter."""

    def __init__(self, parameters: Parameters) -> None:
        (weight, self._bias), *self._layers = parameters.layers("forward")
        self._encoding = parameters.shape.encoding
        self._seen = weight[:, : self._encoding.width]
        self.columns: Float[Tensor, "h d"] = weight[:, self._encoding.width :]
        """Of the first layer, that features are multiplied by."""

    def without_features(self, positions: Float[Tensor, "n 3"]) -> Float[Tensor, "n h"]:
        """The first layer's sums, features left out."""
        return torch.addmm(self._bias, encode(positions, self._encoding), self._seen.mT)

    def after(self, sums: Float[Tensor, "n h"]) -> Float[Tensor, "n o"]:
        """Outputs, given the first layer's sums."""
        for weight, bias in self._layers:
            sums = torch.addmm(bias, torch.relu(sums), weight.mT)
        return sums


def code_bits(codes: Int[Tensor, " v"]) -> Callable[[Int[Tensor, " v"]], Float[Tensor, " v"]]:
    """What a code costs under the coder's model, a logistic distribution of the column's mean magnitude."""
    scale = max(float(codes.abs().double().mean()), _LEAST_MEAN) / (2 * math.log(2))
    largest = int(codes.abs().max()) + 1
    edges = torch.arange(-largest, largest + 2, device=codes.device).double() - 0.5
    # Of the tail that the code is in, so that the difference of two numbers near one is not taken.
    share = torch.sigmoid(-edges.abs() / scale)
    mass = torch.where(edges[1:] * edges[:-1] < 0, 1 - share[1:] - share[:-1], (share[1:] - share[:-1]).abs())
    table = -torch.log2(mass.clamp_min(2.0**-18)).float()
    return lambda some: table[some + largest]


def independent_sets(faces: Int[Tensor, "f 3"], count: int) -> Iterator[Bool[Tensor, " v"]]:
    """All vertices once, in sets of vertices that share no face.

    Reference: local maxima of random numbers, Luby 1986.
    """
    rank = torch.randperm(count, generator=torch.Generator().manual_seed(0)).to(faces.device)
    left = torch.ones(count, dtype=torch.bool, device=faces.device)
    while left.any():
        ranks = torch.where(left, rank, -1)
        highest = ranks.clone()
        around = ranks[faces].amax(1, keepdim=True).expand(-1, 3)
        highest.scatter_reduce_(0, faces.flatten(), around.flatten(), "amax")
        chosen = left & (highest == rank)
        left &= ~chosen
        yield chosen
