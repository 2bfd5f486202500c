"""The smallest box that a field's Lipschitz bound can prove the surface to lie in."""

from __future__ import annotations

import itertools

import numpy as np
import torch
from jaxtyping import Int
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.implicit_field import ImplicitField

_MOST_WORK = 30_000_000
"""Most evaluations of primitives."""
_FINEST = 6
"""Levels of halving: cells of 1/64 of the box."""
_CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))


def tightened(field: ImplicitField, cost: int) -> Box:
    """`field.bounds` without its empty margins.

    A cell cannot hold the surface where |phi| > L * half its diagonal at its centre. Boxes of rotated parts and of
    differences are loose, and the resolution of the base mesh is a share of the box.

    Args:
        field: the field with a box that holds its surface.
        cost: work of one evaluation, in primitives.

    Raises:
        InputError: no cell can hold the surface.
    """
    found, level, work = _occupied(field, np.zeros((1, 3), dtype=np.int64), 0), 0, cost
    while level < _FINEST:
        children = (2 * found[:, None] + _CORNERS).reshape(-1, 3)
        work += len(children) * cost
        if level >= 2 and work > _MOST_WORK:
            break
        level += 1
        found = _occupied(field, children, level)
    box = field.bounds
    edge = (box.upper - box.lower) / 2**level
    # Half a cell on each side, so that the surface does not touch the box.
    lower, upper = (found.min(axis=0) - 0.5) * edge, (found.max(axis=0) + 1.5) * edge
    return Box(np.maximum(box.lower + lower, box.lower), np.minimum(box.lower + upper, box.upper))


def _occupied(field: ImplicitField, cells: Int[Array, "m 3"], level: int) -> Int[Array, "k 3"]:
    """Those cells of the box's division into 2^level parts per axis that can hold the surface."""
    edge = (field.bounds.upper - field.bounds.lower) / 2**level
    values = field.values(torch.from_numpy(field.bounds.lower + (cells + 0.5) * edge)).abs().numpy()
    kept = cells[values <= field.lipschitz * np.linalg.norm(edge) / 2 * (1 + 1e-9)]
    if not len(kept):
        raise InputError("the solid is empty: its field is nowhere zero; do its parts lie where they should?")
    return kept
