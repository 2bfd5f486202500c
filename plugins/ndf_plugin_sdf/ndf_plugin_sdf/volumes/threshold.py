"""Choosing the iso value, and which side of it is inside."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_plugin_sdf.volumes.volume import Volume

_BINS = 512
_CUT = 1e-3
"""Share of the voxels at each end that may be outliers: the histogram spans the rest."""
_UNIFORM = 1.6
"""Ratio of the gradients' 90% and 10% quantiles at the zeros of a distance; of images it is far larger."""


def chosen_iso(volume: Volume) -> tuple[float, str]:
    """An iso value, and one line about why.

    Raises:
        InputError: all voxels are equal.
    """
    values = volume.values
    low, high = float(values.min()), float(values.max())
    if low == high:
        raise InputError(f"all voxels are {low:.6g}: there is no level set")
    if low < 0 < high and _grows_evenly(volume):
        return 0.0, "iso value 0: the values grow evenly across it, as distances do"
    iso = _otsu(values)
    return iso, f"iso value {iso:.6g}, by Otsu's method from values of {low:.6g} to {high:.6g}; --iso sets another"


def border_above(values: Float[Array, "x y z"], iso: float) -> float:
    """Share of the voxels on the volume's six faces that are above the iso value."""
    faces = [values.take(end, axis).ravel() for axis in range(3) for end in (0, -1)]
    return float((np.concatenate(faces) > iso).mean())


def _grows_evenly(volume: Volume) -> bool:
    """Whether the values change at the same rate all along their zeros."""
    values = volume.values
    slopes = np.zeros(values.shape, np.float32)
    for axis, step in enumerate(volume.spacing):
        slopes += (np.gradient(values, axis=axis) / np.float32(step)) ** 2
    crossing = np.zeros(values.shape, bool)
    for axis in range(3):
        first, second = np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]
        np.moveaxis(crossing, axis, 0)[:-1] |= (first < 0) != (second < 0)
    low, high = np.sqrt(np.quantile(slopes[crossing], [0.1, 0.9]))
    return bool(high <= _UNIFORM * low)


def _otsu(values: Float[Array, "x y z"]) -> float:
    """The threshold between two classes whose means differ most, weighted by their sizes.

    Reference: N. Otsu, A threshold selection method from gray-level histograms, 1979.
    """
    ends = np.quantile(values, [_CUT, 1 - _CUT])
    low, high = (float(end) for end in (ends if ends[0] < ends[1] else (values.min(), values.max())))
    counts, edges = np.histogram(np.clip(values, low, high), _BINS, (low, high))
    middle = 0.5 * (edges[:-1] + edges[1:])
    below, moment = np.cumsum(counts).astype(float), np.cumsum(counts * middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (moment[-1] * below - moment * below[-1]) ** 2 / (below * (below[-1] - below))
    # Where a range of values does not occur, all thresholds in it are equally good: the middle is farthest from both.
    best = np.flatnonzero(between >= np.nanmax(between) * (1 - 1e-9))
    return float(edges[1 + best[len(best) // 2]])
