"""How geodesic distances change when edge lengths change a little: the interface of `src/variation.c`."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels import _variation  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub


def vary_distances(
    faces: Int[Array, "f 3"],
    before: Float[Array, "f 3"],
    after: Float[Array, "f 3"],
    distances: Float[Array, " v"],
    known: Float[Array, " v"],
) -> Float[Array, " v"]:
    """The change of geodesic distances from lengths `before` to lengths `after`, to first order.

    A shortest path stays the shortest to first order, so its own change of length is that of the distance.

    Laws: linear in small changes of the lengths; no change where they stay; where all lengths grow by a share, so do
    distances.

    Args:
        faces: Of the mesh.
        before: Lengths of the sides, from corner i to corner i + 1.
        after: The same.
        distances: Under the lengths before; infinite where no source is connected.
        known: Changes that are known, around the sources; NaN elsewhere.

    Raises:
        IndexError: a face names a vertex that does not exist.
        ValueError: the numbers of rows do not match.
    """
    shifts = np.array(known, dtype=np.float64)
    order = np.argsort(distances, kind="stable").astype(np.int32)
    _variation.spread(
        shifts,
        np.ascontiguousarray(faces, dtype=np.int32),
        np.ascontiguousarray(before, dtype=np.float64),
        np.ascontiguousarray(after, dtype=np.float64),
        np.ascontiguousarray(distances, dtype=np.float64),
        order[np.isfinite(distances[order])],
    )
    return shifts
