"""Where a base mesh that several assets share lies on the surface of one of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.asset.base_mesh_codec import BOX_SIDE
from ndf_core.errors import FitError

_STEP = float(np.float32(BOX_SIDE / 4095))
"""As fine as the grid of base meshes."""


@dataclass(frozen=True)
class Placement:
    """Places of a base mesh's vertices on a grid."""

    codes: Int[Array, "v 3"]
    """int16: each the way from the vertex before, which is near in Draco's order."""
    step: float = _STEP

    @classmethod
    def of(cls, positions: Float[Array, "v 3"]) -> Placement:
        """Rounded positions of the box frame.

        Raises:
            FitError: they lie far outside of it.
        """
        codes = np.diff(np.rint(positions / _STEP), axis=0, prepend=0)
        if not (np.abs(codes) <= np.iinfo(np.int16).max).all():
            raise FitError("the base mesh comes to lie far outside of the surface")
        return cls(codes.astype(np.int16))

    @cached_property
    def positions(self) -> Float[Array, "v 3"]:
        """float64, box frame; the same bits on every machine."""
        return np.cumsum(self.codes, axis=0, dtype=np.int64) * self.step
