"""Where the object is: in the box that the user gave, or in the part of the bounds that holds a closed object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_plugin_nerf.density import Density
from ndf_plugin_nerf.lattice import Nodes
from ndf_plugin_nerf.outside import box_of, flooded, parts_of
from ndf_plugin_nerf.sampled import sample_all
from ndf_plugin_nerf.threshold import threshold_from_histogram

_ACROSS = 96
"""Cells of the overview grid along the longest side."""
_MARGIN = 1.5
"""Cells of the overview grid to leave around what it sees."""
_LEAST = 1e-3
"""An object above a background fills at least this share of the bounds; less is dust."""


@dataclass(frozen=True)
class Region:
    """A box around the object, the threshold in it, and what the user should know."""

    box: Box
    threshold: float
    notes: tuple[str, ...]


def find_region(density: Density, crop: Box | None, threshold: float | None, least_part: float) -> Region:
    """Look at the density on a coarse grid, choose what was not given, and shrink the box to what is there.

    Without a crop box, a solid that runs through the sides of the bounds is a background. If one straight cut across
    an axis leaves an object that touches no other side, the box is cut there, and a note says so.

    Args:
        density: with the bounds to look in.
        crop: the user's box.
        threshold: the user's threshold.
        least_part: parts with a smaller share of the largest one's volume do not count.

    Raises:
        InputError: nothing is above the threshold; or no object is closed, and no crop box was given.
    """
    box = crop or density.bounds
    nodes = Nodes.over(box, _ACROSS)
    values = sample_all(density, nodes)
    solid = values >= _chosen(values, box, threshold)
    cut = None if crop else background_cut(solid)
    start = np.zeros(3)
    if cut is not None:
        start = np.array([part.start or 0 for part in cut])
        solid, values = solid[cut], values[cut]
    first, last = _occupied(solid, least_part) + start
    low, high = nodes.positions(start), nodes.positions(start + np.array(values.shape) - 1)
    tight = Box(np.maximum(nodes.positions(first - _MARGIN), low), np.minimum(nodes.positions(last + _MARGIN), high))
    notes: list[str] = []
    if cut is not None:
        corners = ",".join(f"{x:.3g}" for x in (*tight.lower, *tight.upper))
        notes.append(f"a background runs through the sides of the bounds; it was cut off, as by --crop {corners}")
    chosen = _chosen(values, tight, threshold)
    if threshold is None:
        notes.append(
            f"density threshold {chosen:.3g}: the lower end of the histogram of what is no fog (--threshold)"
        )
    return Region(tight, chosen, tuple(notes))


def background_cut(solid: Bool[Array, "x y z"]) -> tuple[slice, slice, slice] | None:
    """The part of the grid that one cut across an axis leaves of a solid with a background; None without background.

    A background, a ground for example, has slices across some axis in which it meets all four sides of the grid. Cut
    away is every slice that touches a side, and what lies beyond. Of all such cuts, that which leaves the most of the
    solid is taken.

    Raises:
        InputError: something touches the sides, and no cut leaves an object that touches none.
    """
    if not any(bool(np.moveaxis(solid, axis, 0)[[0, -1]].any()) for axis in range(3)):
        return None
    best: tuple[int, tuple[slice, slice, slice]] | None = None
    for axis in range(3):
        slices = np.moveaxis(solid, axis, 0)
        sides = np.stack([slices[:, 0].any(1), slices[:, -1].any(1), slices[:, :, 0].any(1), slices[:, :, -1].any(1)])
        if not sides.all(axis=0).any():
            continue
        touching = np.flatnonzero(sides.any(axis=0))
        for part, far in ((slice(int(touching[-1]) + 1, None), -1), (slice(0, int(touching[0])), 0)):
            amount = int(slices[part].sum())
            if not slices[far].any() and amount > max(_LEAST * solid.size, best[0] if best else 0):
                whole = [slice(None)] * 3
                whole[axis] = part
                best = amount, (whole[0], whole[1], whole[2])
    if best is None:
        raise InputError(
            "no closed object: what is dense runs through the sides of the box, and no cut across an axis leaves an "
            "object that touches no side. A forward-facing capture (NDC) has none. If the object is larger than the "
            "box, enlarge it, --bounds '[[-2, -2, -2], [2, 2, 2]]'; otherwise give the box that holds the object, "
            "--crop x0,y0,z0,x1,y1,z1, which closes with flat caps what it cuts"
        )
    return best[1]


def _chosen(values: Float[Array, "x y z"], box: Box, threshold: float | None) -> float:
    chosen = threshold or threshold_from_histogram(values, box.longest_side)
    if chosen is None or not (values >= chosen).any():
        what = "denser than fog" if threshold is None else f"as dense as the threshold {threshold:g}"
        low, high = (", ".join(f"{x:.4g}" for x in corner) for corner in (box.lower, box.upper))
        raise InputError(
            f"nothing is {what} between ({low}) and ({high}); the largest density on a grid of {_ACROSS} is "
            f"{max(float(values.max()), 0.0):.4g}. Check the box (--crop) and --threshold"
        )
    return chosen


def _occupied(solid: Bool[Array, "x y z"], least_part: float) -> Int[Array, "2 3"]:
    """First and last node, along each axis, of the parts that count."""
    parts = parts_of(~flooded(~solid))
    return box_of((parts.label > 0) & (parts.label <= parts.of_share(least_part)))
