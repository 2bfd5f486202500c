"""Bodies and cavities too small to keep: left out of the volume itself, so that all that reads it agrees."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy import ndimage

_ALL_NEIGHBOURS = np.ones((3, 3, 3), bool)


def without_small_parts(phi: Float[Array, "x y z"], smallest: float) -> tuple[Float[Array, "x y z"], tuple[str, ...]]:
    """phi, negative inside, with small bodies turned outside and small cavities turned inside; and what was done.

    Bodies are connected through the faces of voxels, cavities through corners as well, as their complement.

    Args:
        phi: float32.
        smallest: share of the largest body's voxels that a part must have.
    """
    if smallest == 0:
        return phi, ()
    phi = phi.copy()
    left_out = _turned(phi, _labelled(phi < 0, None), smallest, None)
    filled = _turned(phi, _labelled(phi >= 0, _ALL_NEIGHBOURS), smallest, int((phi < 0).sum()))
    lines: list[str] = []
    if left_out:
        lines.append(f"{left_out} bodies smaller than {smallest:g} of the largest are left out (--smallest-part)")
    if filled:
        lines.append(f"{filled} cavities smaller than {smallest:g} of the body are filled (--smallest-part)")
    return phi, tuple(lines)


def _turned(phi: Float[Array, "x y z"], labels: Int[Array, "x y z"], smallest: float, reference: int | None) -> int:
    """Give small parts the values of the nearest voxels on the other side, in place; returns how many parts.

    Not their own with the sign changed: a spike of either sign makes the spline swing across zero beside it.
    Bodies are compared with the largest of them; cavities, with a `reference`, do not reach the border.
    """
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    small = np.asarray(sizes < smallest * (sizes.max() if reference is None else reference))
    if reference is not None:
        for axis, end in itertools.product(range(3), (0, -1)):
            small[labels.take(end, axis)] = False
    small[0] = False
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        if small[number]:
            around = tuple(slice(max(0, side.start - 1), side.stop + 1) for side in place)
            here = labels[around] != 0
            nearest: Any = ndimage.distance_transform_edt(here, return_distances=False, return_indices=True)
            part = labels[around] == number
            phi[around][part] = phi[around][tuple(nearest)][part]
    return int(small.sum())


def _labelled(where: Bool[Array, "x y z"], structure: Bool[Array, "3 3 3"] | None) -> Int[Array, "x y z"]:
    # Declared to return a count alone or both; without `output` it is both.
    answer: Any = ndimage.label(where, structure)
    return answer[0]


def clear_of_zero(phi: Float[Array, "x y z"]) -> Float[Array, "x y z"]:
    """phi, with the voxels away from its surface kept at a distance from zero.

    A spline swings: between voxels that all are of one side, but close to zero, it has islands of the other side that
    no voxel shows. So |phi| is at least its usual value beside the surface wherever no neighbour has the other sign.
    The surface itself, which lies between neighbours of different signs, keeps its voxels.
    """
    inside = phi < 0
    all_inside = np.asarray(ndimage.minimum_filter(inside, 3), bool)
    none_inside = ~np.asarray(ndimage.maximum_filter(inside, 3), bool)
    beside = ~(all_inside | none_inside)
    level = np.float32(np.median(np.abs(phi[beside])))
    cleared = np.where(all_inside, np.minimum(phi, -level), phi)
    return np.where(none_inside, np.maximum(cleared, level), cleared)
