"""Where a base mesh that several assets share lies on the surface of one of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.asset.base_mesh_codec import BOX_SIDE
from ndf_core.errors import FitError
from ndf_core.mesh import face_normals

_STEP = float(np.float32(BOX_SIDE / 8191))
_ROUNDS = 50


@dataclass(frozen=True)
class Placement:
    """Places of a base mesh's vertices on a grid."""

    codes: Int[Array, "v 3"]
    """int16: each the way from the vertex before, which is near in Draco's order."""
    step: float = _STEP

    @classmethod
    def of(cls, positions: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Placement:
        """Rounded positions of the box frame; where triangles have no area, a few steps from there.

        Laws: every triangle has an area (vertices landed along a sharp edge have none between them).

        Raises:
            FitError: they lie far outside of the box frame, or many of them at one place.
        """
        grid, rng = np.rint(positions / _STEP), np.random.default_rng(0)
        for _ in range(_ROUNDS):
            flat = ~face_normals(grid, faces).any(axis=1)
            if not flat.any():
                break
            beside = np.unique(faces[flat])
            grid[beside] += rng.integers(-1, 2, (len(beside), 3))
        else:
            raise FitError("the base mesh collapses on the surface: some anchors contradict each other")
        codes = np.diff(grid, axis=0, prepend=0)
        if not (np.abs(codes) <= np.iinfo(np.int16).max).all():
            raise FitError("the base mesh comes to lie far outside of the surface")
        return cls(codes.astype(np.int16))

    @cached_property
    def positions(self) -> Float[Array, "v 3"]:
        """float64, box frame; the same bits on every machine."""
        return np.cumsum(self.codes, axis=0, dtype=np.int64) * self.step
