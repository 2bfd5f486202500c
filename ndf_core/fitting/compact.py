"""Bring the features into the coordinates in which they cost the fewest bits; the field itself does not change.

The first layer sees the features only through W u, so any invertible A gives the same field from A u and W A^-1.
Two choices make A: errors of the new features should count the same in every direction (sensitivity M = identity),
and in that metric the features should be uncorrelated over the vertices, which is where a coder with one scale per
column spends the least (the Karhunen-Loeve transform).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.fitting.geometry import BaseGeometry, mapped_frame
from ndf_core.fitting.network import Parameters, displace, interpolate
from ndf_core.fitting.sampling import BasePoints

TANGENTIAL_WEIGHT = 0.1
"""An error along the surface hardly moves it: it counts this much of one along the normal."""


def error_metric(parameters: Parameters, geometry: BaseGeometry, base: BasePoints) -> Float[Tensor, "n 3 3"]:
    """Square root of the quadratic form that weighs an error of g at each base point: n n^T + w (1 - n n^T)."""
    normal = mapped_frame(parameters, geometry, base.face, base.barycentric).frame.normal
    along = normal[:, :, None] * normal[:, None, :]
    root = TANGENTIAL_WEIGHT**0.5
    return along + root * (torch.eye(3, device=normal.device) - along)


def canonical_features(parameters: Parameters, geometry: BaseGeometry, base: BasePoints) -> None:
    """Replace a displacement's features and first-layer weights in place, as the module describes."""
    if parameters.shape.feature_dim:
        decorrelate(parameters, _feature_sensitivity(parameters, geometry, base))


def decorrelate(parameters: Parameters, sensitivity: Float[Tensor, "d d"]) -> None:
    """Replace features and first-layer weights in place; float64 inside.

    Args:
        parameters: The field does not change.
        sensitivity: Mean over the surface of J^T J with J the derivative of the output by the features there, in the
            metric that errors of the output are weighed by.
    """
    count, start = parameters.shape.feature_dim, parameters.shape.encoding.width
    # A direction that the network ignores would be scaled without bound the other way: bound the condition number.
    sensitivity += torch.eye(count, dtype=torch.float64) * sensitivity.diagonal().mean().clamp_min(1e-30) * 1e-6
    root = torch.linalg.cholesky(sensitivity).mT
    features = parameters.features.double().cpu() @ root.mT
    centred = features - features.mean(0)
    basis = torch.linalg.eigh(centred.mT @ centred).eigenvectors.flip(1)
    basis = basis * torch.where(basis.sum(0) < 0, -1.0, 1.0)
    features = features @ basis
    weight = parameters.views["forward.weight.0"]
    columns = weight[:, start : start + count].double().cpu() @ torch.linalg.inv(root) @ basis
    # The mean goes into the bias, so that codes are centred where the coder expects them; features of unit size keep
    # their columns of the first layer as sensitive as those of the encoding, with which they share a grid.
    mean = features.mean(0)
    size = (features - mean).square().mean().sqrt().clamp_min(1e-30)
    parameters.views["forward.bias.0"] += (columns @ mean).to(weight)
    parameters.features.copy_(((features - mean) / size).to(weight))
    weight[:, start : start + count] = (columns * size).to(weight)


def _feature_sensitivity(parameters: Parameters, geometry: BaseGeometry, base: BasePoints) -> Float[Tensor, "d d"]:
    """Mean over the base points of J^T Q J with J = dg/du and Q the error metric."""
    metric = error_metric(parameters, geometry, base)
    features = interpolate(parameters.features, base.batch.corners, base.barycentric)
    total = torch.zeros(features.shape[1], features.shape[1], dtype=torch.float64)
    for axis in range(3):
        live = features.clone().requires_grad_()
        output = (displace(parameters, base.batch.positions, live) * metric[:, axis]).sum()
        (row,) = torch.autograd.grad(output, live)
        total += (row.double().mT @ row.double()).cpu()
    return total / len(features)
