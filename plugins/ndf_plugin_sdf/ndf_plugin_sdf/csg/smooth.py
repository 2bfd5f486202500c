"""A smooth minimum of any number of fields: symmetric, local, and never steeper than the fields are."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_plugin_sdf.csg.arithmetic import root


def smooth_minimum(fields: Float[Tensor, "m n"], radius: float) -> Float[Tensor, " n"]:
    """The number t - radius with ``sum over i of max(t - fields_i, 0)^2 = radius^2``.

    It does not depend on the order of the fields, equals their minimum wherever the others lie `radius` above it or
    more, and is once continuously differentiable. Implicitly, its gradient is the mean of the fields' gradients with
    weights max(t - fields_i, 0): a convex combination, so Lipschitz bounds carry over. With two orthogonal planes
    the zero set is (radius - f_1)^2 + (radius - f_2)^2 = radius^2, a circular fillet. Polynomial smooth minima of
    two fields have neither the symmetry for three and more nor the meaning of the radius.
    """
    lowest = fields.amin(dim=0)
    with torch.no_grad():
        rows = ((fields < lowest + radius).sum(dim=0) > 1).nonzero()[:, 0]
    return lowest.index_copy(0, rows, _blend(fields[:, rows], radius))


def _blend(fields: Float[Tensor, "m n"], radius: float) -> Float[Tensor, " n"]:
    """t - radius where at least two fields are within reach."""
    if len(fields) == 2:
        one, two = fields.unbind()
        # t is the mean plus the root of (radius^2 - sum of squares about the mean) / 2.
        return 0.5 * (one + two) + 0.5 * root(2.0 * radius**2 - (one - two).square()) - radius
    with torch.no_grad():
        t = _level(fields, radius)
    # One differentiable Newton step at the root: its derivative is the implicit function's.
    excess = (t - fields).clamp_min(0.0)
    total = excess.detach().sum(dim=0)
    return t - 0.5 * (excess.square().sum(dim=0) - radius**2) / total - radius


def _level(fields: Float[Tensor, "m n"], radius: float) -> Float[Tensor, " n"]:
    """Root t by Newton from the right, where the sum is convex and at least radius^2: monotone, some five steps.

    A column stops at its first step without progress, so that its answer does not depend on the other columns.
    """
    offset = fields.amin(dim=0)
    above = fields - offset
    t = torch.full_like(offset, radius)
    for _ in range(64):
        excess = (t - above).clamp_min(0.0)
        following = t - 0.5 * (excess.square().sum(dim=0) - radius**2) / excess.sum(dim=0)
        moving = following < t * (1.0 - 1e-15)
        if not bool(moving.any()):
            break
        t = torch.where(moving, following, t)
    return t + offset
