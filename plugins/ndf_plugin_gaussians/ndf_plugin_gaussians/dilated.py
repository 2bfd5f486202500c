"""The paper's solid of splats: their centres dilated (Sec. 4.1, Fig. dilation)."""

from __future__ import annotations

import numpy as np

from ndf_core.surfaces.dilation import closing_radius, distance_beyond, sampling_spacing
from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.openness import HIDDEN, openness
from ndf_plugin_gaussians.solid import Solid, without_crumbs
from ndf_plugin_gaussians.splats import Splats

_WIDEST = 0.05
"""Largest radius that is tried, as a share of the longest side."""
_QUANTILE = 0.9
"""Where no radius closes, nine of ten centres touch their neighbours."""
_REACH = 2.0
"""Cells beyond the balls up to which distances are looked up."""


def dilated_solid(splats: Splats, grid: Grid, min_component: float) -> Solid:
    """Balls around the centres, of the smallest radius at which they close around an inside, and that inside.

    Args:
        splats: those that count.
        grid: where the distance to the centres is sampled.
        min_component: smallest component kept, as a share of the largest.

    Raises:
        BaseMeshError: nothing is inside.
    """
    spacing = sampling_spacing(splats.centres)
    size = float(np.ptp(splats.centres, axis=0).max())
    radius = closing_radius(splats.centres, float(np.median(spacing)), _WIDEST * size)
    note = "at which they close around an inside"
    if radius is None:
        radius = min(float(np.quantile(spacing, _QUANTILE)), _WIDEST * size)
        note = f"no radius up to {_WIDEST:g} of the longest side closes around an inside"
    radius = max(radius, grid.step)
    limit = _REACH * grid.step
    nodes = grid.nodes(np.stack(np.unravel_index(np.arange(int(np.prod(grid.shape))), grid.shape), axis=1))
    beyond = distance_beyond(splats.centres, radius, radius + limit)(nodes)
    field = -np.minimum(beyond, limit).reshape(grid.shape) / limit
    # Balls of the radius at which cells close leave gaps of less than a cell: what they hide all the same is inside.
    hidden = np.clip((HIDDEN - openness(field > 0)) / HIDDEN, -1.0, 1.0)
    field = np.where(field > 0, field, np.maximum(field, hidden))
    field, dropped = without_crumbs(field, min_component)
    return Solid(field, radius, (f"centres dilated by {radius:.4g} ({note})", *dropped))
