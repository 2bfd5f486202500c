"""Which density counts as solid, where the user does not say."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

_MATTER = 0.5
"""Optical thickness along the longest side below which space counts as empty."""
_THINNEST = 10.0
"""A threshold of less than this optical thickness per longest side would take fog for a surface: half of the light
passes 7% of the size."""
_SHARE = 0.05


def threshold_from_histogram(densities: Float[Array, "..."], size: float) -> float | None:
    """The density that 95% of the matter exceeds, but no fog; None where nothing is denser than fog.

    The histograms of trained NeRFs have no valley between empty and solid: they rise from zero to a broad mode. Its
    lower end encloses the matter, with little of what floats.

    Args:
        densities: at points spread evenly over the box that holds the object.
        size: longest side of that box, input units; densities are per unit.
    """
    matter = densities[densities > _MATTER / size]
    if not len(matter) or matter.max() <= _THINNEST / size:
        return None
    # Of a solid with one density everywhere, half of it.
    return float(max(min(np.quantile(matter, _SHARE), matter.max() / 2), _THINNEST / size))
