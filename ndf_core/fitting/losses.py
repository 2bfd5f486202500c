"""The optional losses of App. D, through autograd; the two that every fit has are in `step`."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.config.fit import LossWeights
from ndf_core.errors import ConfigError
from ndf_core.fitting.geometry import BaseGeometry, MappedFrame, mapped_frame
from ndf_core.fitting.network import Parameters, displace, interpolate
from ndf_core.fitting.sampling import BasePoints


class Anchors:
    """Base points p_i and the surface points q_i that they are to be mapped to, box frame (App. D.1)."""

    def __init__(self, base: BasePoints, targets: Float[Tensor, "m 3"]) -> None:
        self.base = base
        self.targets = targets


def optional_gradient(
    parameters: Parameters,
    geometry: BaseGeometry,
    base: BasePoints,
    normals: Float[Tensor, "n 3"] | None,
    weights: LossWeights,
    anchors: Anchors | None,
) -> Float[Tensor, " p"] | None:
    """Gradient of the weighted anchor, normal and conformality losses; None where all of them are off.

    `normals` are the surface's at the projections of `base`, zero where there is none: such rows count in neither of
    the last two. Without any, det J keeps its unsigned value.

    Raises:
        ConfigError: there is a weight for the normal loss, and the surface has no normals.
    """
    if weights.normal and normals is None:
        raise ConfigError("--loss.normal needs surface normals, and this representation gives none; leave it out")
    if not (weights.normal or weights.conformality or (weights.anchor and anchors is not None)):
        return None
    flat = parameters.flat.detach().requires_grad_()
    live = Parameters(parameters.shape, flat)
    total = flat.new_zeros(())
    if weights.anchor and anchors is not None:
        total = total + weights.anchor * anchor_loss(live, anchors)
    if weights.normal or weights.conformality:
        mapped = mapped_frame(live, geometry, base.face, base.barycentric)
        sides = None if normals is None else (mapped.frame.normal.detach() * normals).sum(1).sign()
        total = total + (weights.conformality or 0.0) * conformality_loss(mapped, sides, base.weight)
        if normals is not None:
            total = total + (weights.normal or 0.0) * normal_loss(mapped, normals, base.weight)
    return torch.autograd.grad(total, flat)[0]


def anchor_loss(parameters: Parameters, anchors: Anchors) -> Float[Tensor, ""]:
    """Sum of |g(p_i) - q_i|^2. App. D.1 prints g(q_i), but q_i lies on the surface already."""
    batch = anchors.base.batch
    features = interpolate(parameters.features, batch.corners, batch.barycentric)
    return (displace(parameters, batch.positions, features) - anchors.targets).square().sum()


def normal_loss(
    mapped: MappedFrame, normals: Float[Tensor, "n 3"], weight: Float[Tensor, " n"] | None = None
) -> Float[Tensor, ""]:
    """Mean of |n_theta - n_surface|^2 (App. D.2); rows without a surface normal (zero) add nothing."""
    known = normals.any(dim=1)
    return _mean((mapped.frame.normal - normals).square().sum(1) * known, weight)


def conformality_loss(
    mapped: MappedFrame, sides: Float[Tensor, " n"] | None, weight: Float[Tensor, " n"] | None = None
) -> Float[Tensor, ""]:
    """Mean of softplus_10(-det J / tr J^T J) (App. D.3).

    det J_f is never negative in the frame built from J itself, so its sign is taken from `sides`: that of
    n_theta . n_surface at the projection, -1 where the map is folded over. Rows of side 0 have no gradient.
    """
    determinant = mapped.area_ratio if sides is None else mapped.area_ratio * sides
    trace = mapped.jacobian.square().sum((1, 2))
    return _mean(torch.nn.functional.softplus(-determinant / trace.clamp_min(1e-30), beta=10), weight)


def _mean(values: Float[Tensor, " n"], weight: Float[Tensor, " n"] | None) -> Float[Tensor, ""]:
    return values.mean() if weight is None else (values * weight).mean()
