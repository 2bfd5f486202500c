"""Values of a field at the corners of a lattice, with as few signs as a distance needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ndf_core.base_mesh.lattice import Lattice, ScalarField, evaluate

OUTSIDE = np.inf
"""Value of the corners beyond the bounds: whatever is inside there is cut off."""


@dataclass(frozen=True)
class Sampler:
    """A field on a lattice.

    With `distance`, only one corner of each group is asked for its sign. The bound |field| <= L * distance to the
    level set says that there is no zero between two corners p and q with |field(p)| + |field(q)| > L * |p - q|: a
    zero z there would give |p - q| = |p - z| + |z - q| >= (|field(p)| + |field(q)|) / L. So they are in one group.
    """

    lattice: Lattice
    field: ScalarField
    lipschitz: float | None = None
    distance: ScalarField | None = None

    def sample(self, corners: Int[Array, " n"]) -> Float[Array, " n"]:
        """Values at corners with ascending keys; infinite beyond the bounds."""
        index = self.lattice.corner_index(corners)
        values = np.full(len(corners), OUTSIDE)
        within = np.flatnonzero(self.lattice.within(index))
        points = self.lattice.positions(index[within])
        if self.distance is None or self.lipschitz is None:
            values[within] = evaluate(self.field, points)
            return values
        size = np.abs(evaluate(self.distance, points))
        group = self._groups(corners[within], index[within], size, self.lipschitz)
        # The farthest corner of a group stands for it, where the sign is surest.
        order = np.lexsort((-size, group))
        first = order[np.r_[True, np.diff(group[order]) > 0]] if len(order) else order
        values[within] = np.where((evaluate(self.field, points[first]) < 0)[group], -size, size)
        return values

    def _groups(
        self, corners: Int[Array, " n"], index: Int[Array, "n 3"], size: Float[Array, " n"], lipschitz: float
    ) -> Int[Array, " n"]:
        """Number of the group of each corner."""
        pairs: list[Int[Array, "2 m"]] = []
        for axis in range(3):
            step = np.zeros(3, dtype=np.int64)
            step[axis] = 1
            keys = self.lattice.corner_keys(index + step)
            place = np.minimum(np.searchsorted(corners, keys), max(0, len(corners) - 1))
            near = np.flatnonzero(corners[place] == keys) if len(corners) else place
            other = place[near]
            same = size[near] + size[other] > lipschitz * float(self.lattice.step[axis]) * (1 + 1e-9)
            pairs.append(np.stack([near[same], other[same]]))
        rows, columns = np.concatenate(pairs, axis=1)
        count = len(corners)
        graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(count, count))
        return connected_components(graph, directed=False)[1].astype(np.int64)
