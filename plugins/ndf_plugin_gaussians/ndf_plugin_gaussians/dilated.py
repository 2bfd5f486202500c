"""The paper's base mesh of splats: their centres dilated (Sec. 4.1, Fig. dilation)."""

from __future__ import annotations

import numpy as np

from ndf_core.surfaces.dilation import closing_radius, offset_surface, sampling_spacing
from ndf_plugin_gaussians.solid import Solid
from ndf_plugin_gaussians.splats import Splats

_WIDEST = 0.05
"""Largest radius that is tried, as a share of the longest side."""
_QUANTILE = 0.9
"""Where no radius closes, nine of ten centres touch their neighbours."""


def dilated_solid(splats: Splats) -> Solid:
    """Balls around the centres, of the smallest radius at which they close around an inside.

    Raises:
        BaseMeshError: no manifold mesh can be made.
    """
    centres = splats.centres
    spacing = sampling_spacing(centres)
    size = float(np.ptp(centres, axis=0).max())
    radius = closing_radius(centres, float(np.median(spacing)), _WIDEST * size)
    note = "closed around its inside"
    if radius is None:
        radius = min(float(np.quantile(spacing, _QUANTILE)), _WIDEST * size)
        note = f"no radius up to {_WIDEST:g} of the longest side closes around an inside"
    offset = offset_surface(centres, radius)
    told = f"centres dilated by {radius:.4g} ({note})"
    return Solid(offset.vertices, offset.faces, offset.remarks, (told,), radius)
