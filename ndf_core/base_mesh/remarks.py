"""Keeping lists of remarks short."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.interfaces import Remark

LISTED = 8
"""So many of a kind stay single; the rest share one."""


def condense(remarks: Sequence[Remark]) -> list[Remark]:
    """The largest remarks of each kind, and one more for the rest of the kind with their number.

    Kinds stay in order of first appearance; within a kind the largest comes first.
    """
    kinds = list(dict.fromkeys(remark.kind for remark in remarks))
    return [short for kind in kinds for short in _of_one_kind([r for r in remarks if r.kind == kind])]


def _of_one_kind(remarks: list[Remark]) -> list[Remark]:
    remarks = sorted(remarks, key=lambda remark: -(remark.size or 0.0))
    rest = remarks[LISTED:]
    if not rest:
        return remarks
    count = sum(remark.count for remark in rest)
    message = f"{count} times more: {rest[0].message}; place and size are those of the largest of these"
    return [*remarks[:LISTED], Remark(rest[0].kind, message, rest[0].position, rest[0].size, count)]


def triple(point: Float[Array, " 3"]) -> tuple[float, float, float]:
    """A position as remarks hold it."""
    x, y, z = (float(value) for value in np.asarray(point))
    return x, y, z
