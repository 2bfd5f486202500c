"""Projection along the mapped normal onto the outer level set of a density (Sec. 4.2, ray traceable geometry)."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector
from ndf_plugin_nerf.density import Density
from ndf_plugin_nerf.outer_field import OuterField

TOLERANCE = 1e-5
"""Crossings are known this well, as a share of the longest side of the grid."""
_STRIDE = 4
"""Steps along a ray that are looked at together."""
_HALVINGS = 40


class RayProjector(Projector):
    """Nearest crossing, on the line through a point along its mapped normal, of a surface that faces the same way.

    From inside the ray goes out along the normal, from outside it goes in against it; what the opposite ray meets
    first faces backwards, and would fold the mapped surface. The ray goes in half steps of the grid's cells until the
    outer field changes its sign. There the density itself is asked: within half a cell around that step it must cross
    the threshold, from outside to inside, and this crossing is refined. So the grid decides which crossing (the outer
    one), and the density where it is. Rows without a crossing within `reach`, or where the density has none at that
    place, are not converged. Beyond the grid's box is outside, so flat caps close what it cuts.

    Normals are those of the field on the grid, smoothed over one cell. Computes on the CPU; queries on another device
    are copied there and back.
    """

    needs_directions = True
    parallel = True

    def __init__(self, density: Density, field: OuterField, reach: float) -> None:
        """Take the surface.

        Args:
            density: asked near crossings only.
            field: its outer field.
            reach: how far a ray goes, input units.
        """
        self._density, self._field = density, field.function()
        self._threshold = field.threshold
        box = field.nodes.box
        self._lower, self._upper = torch.from_numpy(box.lower), torch.from_numpy(box.upper)
        self._step = 0.5 * float(field.nodes.step.min())
        self._steps = max(1, round(reach / self._step))
        self._tolerance = TOLERANCE * box.longest_side

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        if directions is None:
            raise InputError("a NeRF is projected onto along directions: it needs one for each point")
        origin, along = (part.detach().to("cpu", torch.float64) for part in (points, directions))
        finite = origin.isfinite().all(dim=1)
        if not bool(finite.all()):
            raise InputError(f"cannot project query point {int((~finite).nonzero()[0])}: a coordinate is not finite")
        length = torch.linalg.vector_norm(along, dim=1, keepdim=True)
        aimed = (length > 0) & length.isfinite()
        along = torch.where(aimed, along / length, 0.0)
        outer, inner = self._bracket(origin, along)
        found, converged = self._refined(origin, along, outer, inner)
        answer = torch.where(converged[:, None], origin + found[:, None] * along, origin)
        normals = torch.nn.functional.normalize(self._field.gradients(answer).double(), dim=1)
        return Projection(answer.to(points), converged.to(points.device), normals.to(points))

    def _bracket(
        self, origin: Float[Tensor, "n 3"], along: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
        """Places on each line, outside and inside, between which the field first changes sign; nan where nowhere."""
        outer, inner = (torch.full((len(origin),), torch.nan, dtype=torch.float64) for _ in range(2))
        within = self._field(origin) < 0
        rows = torch.arange(len(origin))
        for first in range(1, self._steps + 1, _STRIDE):
            if not len(rows):
                break
            number = torch.arange(first, min(first + _STRIDE, self._steps + 1), dtype=torch.float64)
            place = self._step * torch.where(within[rows, None], number, -number)
            at = origin[rows, None, :] + place[:, :, None] * along[rows, None, :]
            changed = (self._field(at.flatten(0, 1)) < 0).view(len(rows), -1) != within[rows, None]
            hit = changed.any(dim=1)
            end = place[hit].gather(1, changed[hit].int().argmax(dim=1, keepdim=True))[:, 0]
            start = end - torch.sign(end) * self._step
            from_inside = within[rows[hit]]
            outer[rows[hit]] = torch.where(from_inside, end, start)
            inner[rows[hit]] = torch.where(from_inside, start, end)
            rows = rows[~hit]
        return outer, inner

    def _refined(
        self,
        origin: Float[Tensor, "n 3"],
        along: Float[Tensor, "n 3"],
        outer: Float[Tensor, " n"],
        inner: Float[Tensor, " n"],
    ) -> tuple[Float[Tensor, " n"], Bool[Tensor, " n"]]:
        """Where the density itself crosses the threshold near the bracket, and whether it does."""
        rows = (outer.isfinite() & inner.isfinite()).nonzero()[:, 0]
        found, converged = torch.zeros_like(outer), torch.zeros_like(outer, dtype=torch.bool)
        start, width = outer[rows], inner[rows] - outer[rows]
        # The grid's crossing is a little off: look half a cell further to either side, from outside inwards.
        places = start[:, None] + width[:, None] * torch.tensor([-1.0, 0.0, 1.0, 2.0], dtype=torch.float64)
        excess = self._excess(origin[rows], along[rows], places)
        enters = (excess[:, :-1] < 0) & (excess[:, 1:] >= 0)
        some = enters.any(dim=1)
        column = enters[some].int().argmax(dim=1, keepdim=True)
        rows = rows[some]
        ends = torch.cat([places[some].gather(1, column), places[some].gather(1, column + 1)], dim=1)
        values = torch.cat([excess[some].gather(1, column), excess[some].gather(1, column + 1)], dim=1)
        found[rows] = self._bisected(origin[rows], along[rows], ends, values)
        converged[rows] = True
        return found, converged

    def _bisected(
        self,
        origin: Float[Tensor, "n 3"],
        along: Float[Tensor, "n 3"],
        ends: Float[Tensor, "n 2"],
        values: Float[Tensor, "n 2"],
    ) -> Float[Tensor, " n"]:
        """The crossing between two places, by regula falsi with Illinois' weights, every third turn by halves."""
        ends, values = ends.clone(), values.clone()
        rows = torch.arange(len(ends))
        for turn in range(_HALVINGS):
            width = (ends[rows, 1] - ends[rows, 0]).abs()
            rows = rows[width > self._tolerance]
            if not len(rows):
                break
            low, high = ends[rows].unbind(1)
            share = torch.full_like(low, 0.5)
            if turn % 3 < 2:
                below, above = values[rows].unbind(1)
                share = (below / (below - above)).clamp(0.02, 0.98)
            middle = low + share * (high - low)
            value = self._excess(origin[rows], along[rows], middle[:, None])[:, 0]
            side = (value >= 0).long()
            ends[rows, side], values[rows, side] = middle, value
            # Halving the value at the end that stays keeps the secant from creeping.
            values[rows, 1 - side] *= 0.5
        return ends.mean(dim=1)

    def _excess(
        self, origin: Float[Tensor, "n 3"], along: Float[Tensor, "n 3"], places: Float[Tensor, "n k"]
    ) -> Float[Tensor, "n k"]:
        """Density minus threshold at places on lines; nothing beyond the box."""
        at = (origin[:, None, :] + places[:, :, None] * along[:, None, :]).flatten(0, 1)
        within = ((at >= self._lower) & (at <= self._upper)).all(dim=1)
        return (torch.where(within, self._density.values(at).double(), 0.0) - self._threshold).view(places.shape)
