"""Points of a mesh that need not be vertices."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float, Int
from numpy import ndarray as Array


class SurfacePoints(NamedTuple):
    """Points of a mesh, found as the closest ones to some query points."""

    faces: Int[Array, " n"]
    """int32."""
    barycentric: Float[Array, "n 3"]
    """Weights of the face's corners."""
    positions: Float[Array, "n 3"]
    """The mesh's units."""
    offsets: Float[Array, " n"]
    """Distances from the query points."""
