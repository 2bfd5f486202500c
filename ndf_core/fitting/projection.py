"""A plugin's projector seen from the box frame, with what did not converge left out."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.interfaces import Projector


class BoxProjection(NamedTuple):
    """Projections in the box frame; rows that did not converge repeat the query point, so their residual is zero."""

    points: Float[Tensor, "n 3"]
    converged: Bool[Tensor, " n"]
    normals: Float[Tensor, "n 3"] | None
    """Zero where the row did not converge or its normal is not finite; None where the surface has no normals."""


_ROWS_PER_THREAD = 2048
"""Fewer points are not worth a thread."""


class BoxProjector:
    """Maps box-frame points to input units, projects, and maps back (App. A.1).

    The plugin gets float64 points in input units, whatever their offset; its answer is recentred in float64 before it
    is rounded to the box frame's float32. Many points are shared out over threads, in the order that they come in,
    where the projector is `parallel`.
    """

    def __init__(self, projector: Projector, center: Float[Array, "3"], scale: float, threads: int = 1) -> None:
        self._projector = projector
        threads = threads if projector.parallel else 1
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None
        self._center = torch.as_tensor(center, dtype=torch.float64)
        self._scale = scale
        self.needs_directions = projector.needs_directions

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> BoxProjection:
        """Project float32 box-frame points; the answer is a constant of the loss (no gradient).

        Reference: Sec. 3.2, eq. projection.
        """
        parts = min(self._threads, len(points) // _ROWS_PER_THREAD)
        if self._pool is None or parts < 2 or points.device.type != "cpu":
            return self._project(points, directions)
        size = -(-len(points) // parts)
        shares = points.split(size)
        along = [None] * len(shares) if directions is None else directions.split(size)
        others = [self._pool.submit(self._project, *share) for share in zip(shares[1:], along[1:], strict=True)]
        found = [self._project(shares[0], along[0]), *(other.result() for other in others)]
        normals = [part.normals for part in found if part.normals is not None]
        return BoxProjection(
            torch.cat([part.points for part in found]),
            torch.cat([part.converged for part in found]),
            torch.cat(normals) if len(normals) == len(found) else None,
        )

    def _project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None) -> BoxProjection:
        center = self._center.to(points.device)
        query = points.detach().double() * self._scale + center
        answer = self._projector.project(query, None if directions is None else directions.double())
        found = ((answer.points - center) / self._scale).float()
        converged = answer.converged & torch.isfinite(found).all(dim=1)
        found = torch.where(converged[:, None], found, points.detach())
        return BoxProjection(found, converged, _usable(answer.normals, converged))


def _usable(normals: Float[Tensor, "n 3"] | None, converged: Bool[Tensor, " n"]) -> Float[Tensor, "n 3"] | None:
    if normals is None:
        return None
    known = converged & torch.isfinite(normals).all(dim=1)
    return torch.where(known[:, None], normals, 0.0).float()
