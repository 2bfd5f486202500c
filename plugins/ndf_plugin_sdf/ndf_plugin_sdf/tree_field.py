"""A CSG tree as an `ImplicitField`."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box, overlap
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_plugin_sdf.csg.node import Node
from ndf_plugin_sdf.tighten import tightened

_VALUES_PER_BLOCK = 1 << 22
"""Bounds the memory of a block: a tree keeps some tens of numbers per point and primitive for the gradient."""


class TreeField(ImplicitField):
    """The field of a CSG tree."""

    def __init__(self, tree: Node, bounds: Box | None = None) -> None:
        """Find the box that the surface lies in.

        Args:
            tree: the solid.
            bounds: a box that holds it, for trees whose own box is unbounded or loose.

        Raises:
            InputError: no finite box is known, or no part of the surface lies in it.
        """
        self.tree = tree
        self.block = max(64, min(ImplicitField.block, _VALUES_PER_BLOCK // tree.cost))
        box = tree.bounds() if bounds is None else overlap([tree.bounds(), bounds])
        if not box.empty and not box.finite:
            raise InputError(
                f"it is unbounded along {_infinite_axes(box)}; intersect its planes with a box, or give --bounds"
            )
        if box.empty:
            raise InputError("the solid is empty: its parts do not overlap where they would have to")
        self.bounds = box.grown(0.02 * max(box.longest_side, 1e-9))
        self.lipschitz = tree.lipschitz(self.bounds)
        self.bounds = tightened(self, tree.cost)
        self.lipschitz = tree.lipschitz(self.bounds)

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        return self.tree.distance(points.T.contiguous())


def _infinite_axes(box: Box) -> str:
    infinite = ~(np.isfinite(box.lower) & np.isfinite(box.upper))
    return " and ".join(name for name, open_end in zip("xyz", infinite, strict=True) if open_end)
