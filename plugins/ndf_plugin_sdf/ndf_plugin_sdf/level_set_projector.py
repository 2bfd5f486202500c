"""Projection onto the zero set of an implicit field (Sec. 4.2), corrected towards the closest point (App. C.3)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector
from ndf_plugin_sdf.implicit_field import ImplicitField
from ndf_plugin_sdf.newton import TOLERANCE, Landing, land

MOST_STEPS = 24
MOST_CORRECTING_STEPS = 8
WORTH_CORRECTING = 1e-5
"""Tangential offsets below this share of the size are left alone: a tenth of the error of a good fit."""


class LevelSetProjector(Projector):
    """Moves points to the zero set of a field, close to the closest point.

    Newton's method alone is exact where the field is a distance. Where it is only a bound (inside unions, near smooth
    blends, under twists) it lands off the closest point, by an offset that is tangential to first order; so the query
    is projected onto the tangent plane at the landing point and landed again, as long as that comes nearer.

    Rows that land outside of the field's bounds are not converged: the surface is what lies inside.
    """

    def __init__(self, field: ImplicitField, corrections: int = 3) -> None:
        """Take the field; its bounds set the size that tolerances are shares of.

        Args:
            field: phi, negative inside.
            corrections: most tangential corrections per row.
        """
        self._field = field
        self._corrections = corrections
        self._size = field.bounds.longest_side

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        query = points.detach().to(torch.float64)
        if not bool(query.isfinite().all()):
            row = int((~query.isfinite().all(dim=1)).nonzero()[0])
            raise InputError(f"cannot project query point {row}: a coordinate is not finite")
        landing = land(self._field, query, self._size, MOST_STEPS)
        landing = self._corrected(query, landing)
        found, gradients = landing.points, landing.gradients
        lower, upper = (query.new_tensor(end) for end in (self._field.bounds.lower, self._field.bounds.upper))
        inside = ((found >= lower) & (found <= upper)).all(dim=1)
        converged = inside & (landing.errors <= TOLERANCE * self._size)
        sound = found.isfinite().all(dim=1, keepdim=True)
        normals = torch.nan_to_num(gradients / gradients.square().sum(dim=1, keepdim=True).sqrt())
        return Projection(torch.where(sound, found, query).to(points.dtype), converged, normals.to(points.dtype))

    def _corrected(self, query: Float[Tensor, "n 3"], landing: Landing) -> Landing:
        """Foot points by tangent planes: contracts by about distance times curvature per round.

        Reference: E. Hartmann, On the curvature of curves and surfaces defined by normalforms, 1999.
        """
        best = Landing(*(part.clone() for part in landing))
        rows = (landing.errors <= TOLERANCE * self._size).nonzero()[:, 0]
        damping = torch.ones_like(landing.values)
        for _ in range(self._corrections):
            current = Landing(*(part[rows] for part in best))
            offset = _tangential(query[rows] - current.points, current.gradients) * damping[rows, None]
            worth = offset.square().sum(dim=1).sqrt() > WORTH_CORRECTING * self._size
            worth &= damping[rows] > 0.3  # twice in vain: at an edge, where the offset stays
            rows, offset = rows[worth], offset[worth]
            if not len(rows):
                break
            start = best.points[rows] + offset
            trial = land(self._field, start, self._size, MOST_CORRECTING_STEPS)
            nearer = trial.errors <= TOLERANCE * self._size
            nearer &= _distance(query[rows], trial.points) < _distance(query[rows], best.points[rows])
            damping[rows] = torch.where(nearer, damping[rows], 0.5 * damping[rows])
            for kept, found in zip(best, trial, strict=True):
                kept[rows[nearer]] = found[nearer]
        return best


def _tangential(vectors: Float[Tensor, "m 3"], gradients: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3"]:
    along = (vectors * gradients).sum(dim=1, keepdim=True) / gradients.square().sum(dim=1, keepdim=True)
    return vectors - along * gradients


def _distance(one: Float[Tensor, "m 3"], two: Float[Tensor, "m 3"]) -> Float[Tensor, " m"]:
    return (one - two).square().sum(dim=1).sqrt()
