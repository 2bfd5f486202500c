"""A batch of base points with their projections, which may serve for more than one step.

Near the surface a projection is known for a while: as long as the mapped point moves little, its distance is that to
the plane through the last projection, to second order in the step along the surface. Revisiting a batch against its
planes costs no projection, which pays wherever projecting is dearer than a training step (CSG trees, ray marching).
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.fitting.projection import BoxProjection
from ndf_core.fitting.sampling import BasePoints


class Samples:
    """One batch. Workers fill and read disjoint rows."""

    def __init__(self, base: BasePoints) -> None:
        self.base = base
        positions = base.batch.positions
        self._points, self._normals = torch.zeros_like(positions), torch.zeros_like(positions)
        self._converged = torch.zeros(len(positions), dtype=torch.bool, device=positions.device)
        self._planes = False

    def project(
        self, rows: slice, mapped: Float[Tensor, "n 3"], projector: Callable[[], BoxProjection], first_visit: bool
    ) -> tuple[BoxProjection, bool]:
        """Projections of the mapped points of `rows`, and whether `projector` had to be asked for them.

        After the first visit the planes answer, unless the representation has no normals to make planes from.
        """
        if first_visit or not self._planes:
            projection = projector()
            if projection.normals is not None:
                self._points[rows], self._converged[rows] = projection.points, projection.converged
                self._normals[rows] = projection.normals
                self._planes = True
            return projection, True
        points, converged, normals = self._points[rows], self._converged[rows], self._normals[rows]
        height = ((mapped - points) * normals).sum(1, keepdim=True) * converged[:, None]
        return BoxProjection(mapped - height * normals, converged, normals), False
