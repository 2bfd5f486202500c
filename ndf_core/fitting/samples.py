"""A batch of base points with their projections, which may serve for more than one step.

Near the surface a projection is known for a while: as long as the mapped point moves little, its distance is that to
the plane through the last projection, to second order in the step along the surface. A step against planes costs no
projection, which pays wherever projecting is dearer than training (CSG trees, ray marching); and the planes of some
batches come from one call, which pays where a call is dear by itself.

The last rows of a batch may be pulls (`coverage`): they go to a given point instead of their projection.
"""

from __future__ import annotations

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor

from ndf_core.fitting.projection import BoxProjection
from ndf_core.fitting.sampling import BasePoints


class Samples:
    """One batch."""

    def __init__(self, base: BasePoints, targets: Float[Tensor, "m 3"], planes: BoxProjection | None = None) -> None:
        """`targets` are where the last m rows go; the others go to their projections.

        `planes` are projections of the batch with normals; without them every step projects anew.
        """
        self.base = base
        self.pulls = len(targets)
        """How many rows at the end are pulls."""
        self._targets = targets
        self._planes = planes

    def project(
        self, rows: slice, mapped: Float[Tensor, "n 3"], projector: Callable[[], BoxProjection]
    ) -> tuple[BoxProjection, bool]:
        """Where the mapped points of `rows` go, and whether `projector` was asked for them."""
        projection, asked = self._projected(rows, mapped, projector)
        drawn = len(self.base.face) - self.pulls
        if rows.stop > drawn:
            start = max(rows.start, drawn)
            projection.points[start - rows.start :] = self._targets[start - drawn : rows.stop - drawn]
        return projection, asked

    def _projected(
        self, rows: slice, mapped: Float[Tensor, "n 3"], projector: Callable[[], BoxProjection]
    ) -> tuple[BoxProjection, bool]:
        if self._planes is None or self._planes.normals is None:
            return projector(), True
        points, converged = self._planes.points[rows], self._planes.converged[rows]
        normals = self._planes.normals[rows]
        height = ((mapped - points) * normals).sum(1, keepdim=True) * converged[:, None]
        return BoxProjection(mapped - height * normals, converged, normals), False
