"""Projection onto splats: a smooth surface through those that are seen, or the paper's closest centre (Sec. 4.2)."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector
from ndf_plugin_gaussians.layer import Boundary
from ndf_plugin_gaussians.moving_planes import MovingPlanes

_STEPS = 3
_SETTLED = 0.5
"""A row has converged if its last step was at most so many cells."""


class SmoothProjector(Projector):
    """Onto the zero set of the height above `MovingPlanes`, by steps of that height along the mean normal.

    Rows whose neighbours all face another way, or that still move, do not converge. Normals are the mean normals.
    Runs in double precision on the CPU; queries on another device are copied there and back.
    """

    def __init__(self, planes: MovingPlanes, boundary: Boundary) -> None:
        self._planes, self._boundary = planes, boundary

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        found = _finite(points)
        guide = self._boundary.closest(found)[1]
        normals, settled = guide, np.ones(len(found), dtype=bool)
        for _ in range(_STEPS):
            height, normals, known = self._planes.at(found, guide)
            found = found - height[:, None] * normals
            settled = known & (np.abs(height) <= _SETTLED * self._planes.layer.spacing)
        converged = torch.from_numpy(settled).to(points.device)
        return Projection(torch.from_numpy(found).to(points), converged, torch.from_numpy(normals).to(points))


class CentreProjector(Projector):
    """The closest centre of a splat (Sec. 4.2, Fig. gs); every row converges, there are no normals.

    Runs in double precision on the CPU; queries on another device are copied there and back.
    """

    def __init__(self, centres: Float[Array, "n 3"]) -> None:
        self._tree = KDTree(centres)
        self._centres = centres

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        query = _finite(points)
        index = self._tree.query(query, workers=torch.get_num_threads())[1]
        converged = torch.ones(len(query), dtype=torch.bool, device=points.device)
        return Projection(torch.from_numpy(self._centres[index]).to(points), converged, None)


def _finite(points: Float[Tensor, "n 3"]) -> Float[Array, "n 3"]:
    query = points.detach().to("cpu", torch.float64).numpy()
    finite = np.isfinite(query).all(axis=1)
    if not finite.all():
        raise InputError(f"cannot project query point {int((~finite).argmax())}: a coordinate is not finite")
    return query
