"""Choose the grids that the asset keeps features and networks on: the coarsest that keep the error.

With many small independent rounding errors, bits are spent best where every number adds the same to the squared
error. So tensor t gets the step c / s_t, where s_t^2 is the mean squared change of the mapped point per unit change
of one of its numbers, and the one free number c is raised until the measured error has grown by the budget.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.asset.content import FieldBlock, QuantisedArray
from ndf_core.fitting.blocks import field_blocks
from ndf_core.fitting.compact import canonical_features, error_metric
from ndf_core.fitting.geometry import BaseGeometry, mapped_frame
from ndf_core.fitting.network import Parameters, displace, interpolate, invert
from ndf_core.fitting.projection import BoxProjector
from ndf_core.fitting.sampling import BasePoints, generator_at, mapped_areas, stratified

Grids = dict[str, float]
"""The step of each tensor, by name."""

RMS_BUDGET = 0.018
"""Growth of the projection rms that quantising may cost."""
CYCLE_BUDGET = 0.10
"""Growth of the cycle loss that quantising the inverse may cost."""
_SAMPLES = 16_384
"""For the error that decides; the sensitivities are averages over many numbers and need fewer."""
_PROBE_SAMPLES = 4096
_PROBES = 4
_LARGEST_CODE = 32_000
_BISECTIONS = 10
_STREAM = 2**40
"""Step number of the samples' random stream, beyond any training step."""


def quantise(
    parameters: Parameters, geometry: BaseGeometry, projector: BoxProjector, seed: int, *, keep_inverse: bool
) -> dict[str, FieldBlock]:
    """Field blocks of the trained parameters; `parameters` come back in canonical form, the same field."""
    density = mapped_areas(geometry, parameters)
    base = stratified(geometry, density, _SAMPLES, generator_at(seed, _STREAM))
    probes = stratified(geometry, density, _PROBE_SAMPLES, generator_at(seed, _STREAM + 1))
    canonical_features(parameters, geometry, probes)
    steps = _forward_steps(parameters, geometry, projector, base, probes)
    if keep_inverse:
        steps |= _inverse_steps(rounded(parameters, steps), base, probes)
    # With feature_dim 0 the features are an empty tensor, which any grid holds.
    return field_blocks(parameters.shape, lambda name: stored(parameters, name, steps.get(name, 1.0)), keep_inverse)


def stored(parameters: Parameters, name: str, step: float) -> QuantisedArray:
    """A tensor on the grid of `step`."""
    codes = torch.round(parameters.views[name].double() / step).clamp_(-_LARGEST_CODE, _LARGEST_CODE)
    return QuantisedArray(codes.cpu().numpy().astype(np.int16), step)


def _forward_steps(
    parameters: Parameters, geometry: BaseGeometry, projector: BoxProjector, base: BasePoints, probes: BasePoints
) -> Grids:
    metric = error_metric(parameters, geometry, probes)
    exact = _map(parameters, probes)
    directions = None
    if projector.needs_directions:
        directions = mapped_frame(parameters, geometry, base.face, base.barycentric).frame.normal

    mapped = _map(parameters, base)
    found = projector.project(mapped, directions)

    def error(candidate: Parameters) -> float:
        points = _map(candidate, base)
        if found.normals is None:
            projection = projector.project(points, directions)
            distance = (points - projection.points)[projection.converged]
            return float(distance.double().square().sum(1).mean())
        # Rounding moves points by less than they are away, so that the surface there is its plane to second order.
        height = ((points - found.points) * found.normals).sum(1)[found.converged]
        return float(height.double().square().mean())

    names = [name for name in parameters.views if not name.startswith("inverse") and parameters.views[name].numel()]
    sensitivity = sensitivities(
        parameters, names, lambda candidate: torch.einsum("nij,nj->ni", metric, _map(candidate, probes) - exact)
    )
    allowed = error(parameters) * (1 + RMS_BUDGET) ** 2
    return coarsest(parameters, sensitivity, lambda candidate, _: error(candidate) <= allowed)


def _inverse_steps(parameters: Parameters, base: BasePoints, probes: BasePoints) -> Grids:
    """Steps of the inverse network, given the forward one as it will be decoded."""
    points, probe_points = _map(parameters, base), _map(parameters, probes)
    exact = invert(parameters, probe_points)

    def cycle(candidate: Parameters) -> float:
        return float((invert(candidate, points) - base.batch.positions).double().square().sum(1).mean())

    names = [name for name in parameters.views if name.startswith("inverse")]
    sensitivity = sensitivities(parameters, names, lambda candidate: invert(candidate, probe_points) - exact)
    allowed = cycle(parameters) * (1 + CYCLE_BUDGET)
    return coarsest(parameters, sensitivity, lambda candidate, _: cycle(candidate) <= allowed)


def _map(parameters: Parameters, base: BasePoints) -> Float[Tensor, "n 3"]:
    features = interpolate(parameters.features, base.batch.corners, base.barycentric)
    return displace(parameters, base.batch.positions, features)


def sensitivities(
    parameters: Parameters, names: list[str], change: Callable[[Parameters], Float[Tensor, "n 3"]]
) -> dict[str, float]:
    """Root mean squared change of the output per unit change of one number of each tensor, by random probes."""
    generator = generator_at(0, _STREAM + 2)
    result: dict[str, float] = {}
    for name in names:
        view = parameters.views[name]
        size = 1e-3 * float(view.double().square().mean().sqrt()) + 1e-6
        total = 0.0
        for _ in range(_PROBES):
            candidate = Parameters(parameters.shape, parameters.flat.clone())
            signs = torch.randint(0, 2, view.shape, generator=generator).mul_(2).sub_(1)
            candidate.views[name] += size * signs.to(view)
            total += float(change(candidate).double().square().sum(1).mean())
        result[name] = max((total / _PROBES / view.numel()) ** 0.5 / size, 1e-12)
    return result


def coarsest(
    parameters: Parameters, sensitivity: dict[str, float], accepted: Callable[[Parameters, Grids], bool]
) -> Grids:
    """Steps c / s_t with the largest c, to within a few per cent, that is accepted, given the rounded parameters."""

    def steps(log_c: float) -> Grids:
        least = {n: float(parameters.views[n].abs().max()) / _LARGEST_CODE for n in sensitivity}
        # A step that float32 holds exactly decodes to the same numbers everywhere.
        return {n: float(np.float32(max(2.0**log_c / s, least[n], 1e-12))) for n, s in sensitivity.items()}

    low, high = -30.0, 0.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        grids = steps(middle)
        if accepted(rounded(parameters, grids), grids):
            low = middle
        else:
            high = middle
    return steps(low)


def rounded(parameters: Parameters, grids: Grids) -> Parameters:
    """Parameters as they will be decoded, where `grids` names them."""
    candidate = Parameters(parameters.shape, parameters.flat.clone())
    for name, step in grids.items():
        candidate.views[name].copy_(torch.round(candidate.views[name] / step) * step)
    return candidate
