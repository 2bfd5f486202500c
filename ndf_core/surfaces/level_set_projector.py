"""Projection onto the zero set of an implicit field (Sec. 4.2), corrected towards the closest point (App. C.3)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector
from ndf_core.surfaces.dot_products import squared_length
from ndf_core.surfaces.foot_points import FootPoints, foot_points
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_core.surfaces.newton import TOLERANCE
from ndf_core.surfaces.sign_search import nearest_sign_change

MOST_STEPS = 12
_FAR = 1.0 / 64.0
"""Landings farther away than this share of the size are doubted where the field has plateaus."""


class LevelSetProjector(Projector):
    """Moves points to the zero set of a field, close to the closest point.

    Rows whose |phi| / |grad phi| stays above a millionth of the size are not converged, and neither are rows that
    land outside of the field's bounds: the surface is what lies inside.
    """

    def __init__(self, field: ImplicitField, corrections: int = 2) -> None:
        """Take the field; its bounds set the size that tolerances are shares of.

        Args:
            field: phi, negative inside.
            corrections: most steps along the surface towards the closest point.
        """
        self._field = field
        self.parallel = field.parallel
        self._corrections = corrections
        self._size = field.bounds.longest_side

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        query = points.detach().to(torch.float64)
        finite = query.isfinite().all(dim=1)
        if not bool(finite.all()):
            raise InputError(f"cannot project query point {int((~finite).nonzero()[0])}: a coordinate is not finite")
        feet = self._feet(query)
        lower, upper = (query.new_tensor(end) for end in (self._field.bounds.lower, self._field.bounds.upper))
        inside = ((feet.points >= lower) & (feet.points <= upper)).all(dim=1)
        converged = inside & (feet.errors <= TOLERANCE * self._size)
        sound = feet.points.isfinite().all(dim=1, keepdim=True)
        normals = torch.nan_to_num(feet.gradients / squared_length(feet.gradients).sqrt()[:, None])
        found = torch.where(sound, feet.points, query)
        return Projection(found.to(points.dtype), converged, normals.to(points.dtype))

    def _feet(self, query: Float[Tensor, "n 3"]) -> FootPoints:
        """Newton's landings; rows that it lost, or led away over a plateau, set out again from a change of sign."""
        feet = foot_points(self._field, query, self._size, self._corrections, MOST_STEPS)
        moved = squared_length(feet.points - query).sqrt()
        landed = feet.errors <= TOLERANCE * self._size
        doubtful = (~landed | (moved > _FAR * self._size)).nonzero()[:, 0]
        if not len(doubtful) or not self._field.has_plateaus:
            return feet
        start, found = nearest_sign_change(self._field, query[doubtful], self._size)
        rows = doubtful[found]
        again = foot_points(self._field, query[rows], self._size, self._corrections, MOST_STEPS, start[found])
        distance = squared_length(again.points - query[rows]).sqrt()
        better = (again.errors <= TOLERANCE * self._size) & (~landed[rows] | (distance < moved[rows]))
        for whole, part in zip(feet, again, strict=True):
            whole[rows[better]] = part[better]
        return feet
