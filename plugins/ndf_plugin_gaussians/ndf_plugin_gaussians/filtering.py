"""Which splats count: what is faint, gigantic, far away or alone is left out, by stated rules."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_core.errors import InputError
from ndf_plugin_gaussians.gaussians import GaussiansConfig
from ndf_plugin_gaussians.splats import Splats

_TAIL = 0.002
"""Share of the centres at either end of an axis that does not count for the size."""
_NEIGHBOURS = 8
FEWEST = 16
"""Splats that must be left."""


def filter_splats(splats: Splats, config: GaussiansConfig, origin: str) -> tuple[Splats, tuple[str, ...]]:
    """The splats that count, and one note per rule that left some out.

    In this order: outside the crop box, fainter than `min_opacity`, farther out than `far`, larger than `max_size`,
    more alone than `isolation`. Sizes are shares of the longest side of the middle 99.6% of what the first two leave.

    Raises:
        InputError: hardly any splat is left, or they lie in one point.
    """
    notes: list[str] = []

    def keep(rows: Bool[Array, " n"], why: str) -> None:
        nonlocal splats
        dropped = len(rows) - int(rows.sum())
        if dropped:
            notes.append(f"left out {dropped:,} splats {why}")
            splats = splats.take(rows)
        if len(splats) < FEWEST:
            raise InputError(
                f"{origin}: {len(splats)} splats are left and {FEWEST} needed; {'; '.join(notes) or 'it has no more'}"
            )

    keep(np.ones(len(splats), dtype=bool), "")
    if config.crop is not None:
        low, high = np.array(config.crop[:3]), np.array(config.crop[3:])
        within = np.logical_and(splats.centres >= low, splats.centres <= high)
        keep(np.asarray(within.all(axis=1)), "outside the crop box")
    keep(np.asarray(splats.opacities >= config.min_opacity), f"fainter than {config.min_opacity:g} (--min-opacity)")
    low, high = np.quantile(splats.centres, [_TAIL, 1 - _TAIL], axis=0)
    size = float((high - low).max())
    if not size > 1e-9 * float(np.abs(splats.centres).max()):
        raise InputError(f"{origin}: its splats lie in one point, so there is no surface")
    margin = config.far * size
    near = np.logical_and(splats.centres >= low - margin, splats.centres <= high + margin).all(axis=1)
    keep(near, f"farther out than {config.far:g} of the longest side (--far)")
    small = splats.scales.max(axis=1) <= config.max_size * size
    keep(small, f"larger than {config.max_size:g} of the longest side (--max-size)")
    keep(~_alone(splats, config.isolation), f"{config.isolation:g} times as alone as the median (--isolation)")
    return splats, tuple(notes)


def _alone(splats: Splats, isolation: float) -> Bool[Array, " n"]:
    """Splats whose neighbours are far away, against the median distance and against their own size."""
    distance = _neighbour_distance(splats.centres)
    return (distance > isolation * np.median(distance)) & (distance > isolation * splats.scales.max(axis=1))


def _neighbour_distance(centres: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance to the eighth neighbour."""
    found: Float[Array, "n k"] = np.asarray(KDTree(centres).query(centres, k=_NEIGHBOURS + 1)[0])
    return found[:, -1]
