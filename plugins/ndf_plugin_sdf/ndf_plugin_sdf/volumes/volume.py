"""A volume in memory."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

MOST_VOXELS = 1 << 27
"""512^3: half a gigabyte for each of the few copies that are made."""


@dataclass(frozen=True)
class Volume:
    """Scalars at the points ``matrix @ (i, j, k) + origin``, in the input's units."""

    values: Float[Array, "x y z"]
    """float32; all finite."""
    matrix: Float[Array, "3 3"]
    """Columns are the steps along the three axes; invertible."""
    origin: Float[Array, "3"]
    notes: tuple[str, ...] = ()

    def positions(self, index: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Where voxel coordinates are in the input's units."""
        return index @ self.matrix.T + self.origin

    @property
    def spacing(self) -> Float[Array, "3"]:
        """Lengths of the steps."""
        return np.linalg.norm(self.matrix, axis=0)

    @property
    def corners(self) -> Float[Array, "8 3"]:
        """Positions of the eight voxels at the ends."""
        ends = [(0.0, side - 1.0) for side in self.values.shape]
        return self.positions(np.array(list(itertools.product(*ends))))

    def planes(self) -> tuple[Float[Array, "6 3"], Float[Array, " 6"]]:
        """Outward unit normals and offsets of the six faces through the outermost voxels."""
        rows = np.linalg.inv(self.matrix)
        normals = np.concatenate([-rows, rows]) / np.linalg.norm(np.concatenate([rows, rows]), axis=1, keepdims=True)
        return normals, (self.corners @ normals.T).max(axis=0)

    def cropped(self, inside: Bool[Array, "x y z"], margin: int) -> Volume:
        """The part around the voxels in `inside`, of which there is one."""
        parts: list[slice] = []
        for axis in range(3):
            hit = np.flatnonzero(inside.any(axis=tuple(other for other in range(3) if other != axis)))
            parts.append(slice(max(0, int(hit[0]) - margin), int(hit[-1]) + margin + 1))
        start = np.array([[part.start for part in parts]], np.float64)
        values = np.ascontiguousarray(self.values[tuple(parts)])
        return replace(self, values=values, origin=self.positions(start)[0])
