"""Geodesic distances from points given in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.processing.distance_interpolation import distances_at_middles, interpolate_distances
from ndf_core.processing.exact_geodesics import exact_distances, straight_to
from ndf_core.processing.heat_method import heat_distances
from ndf_core.processing.operators import Operators
from ndf_core.processing.surface_points import SurfacePoints

GeodesicMethod = Literal["heat", "exact"]


@dataclass(frozen=True)
class Geodesics:
    """Distances to the nearest of some sources."""

    distances: Float[Array, " v"]
    """Of each vertex, in the mesh's units; infinity on components without a source."""
    sources: SurfacePoints
    """Where the sources came to lie on the mesh."""
    unreached_components: int
    """Components without a source."""
    approximated: int
    """Distances that the exact method missed and that are bounds from above, too long by less than an edge."""
    operators: Operators = field(repr=False)
    """Of the mesh."""

    @property
    def shown(self) -> Float[Array, " v"]:
        """The distances with NaN, which colour maps know, in the place of infinity."""
        return np.where(np.isfinite(self.distances), self.distances, np.nan)

    @property
    def largest(self) -> float:
        """The largest finite distance."""
        return float(np.nanmax(self.shown))

    @property
    def unreached_vertices(self) -> int:
        return int(np.isnan(self.shown).sum())

    def at(self, points: SurfacePoints) -> Float[Array, " n"]:
        """Distances of points of the mesh (`Operators.closest`), to second order between vertices.

        Fronts are curved: on coarse meshes the mean error is a tenth to a third less than by linear interpolation.
        """
        corners = self.distances[self.operators.faces[points.faces]]
        found = interpolate_distances(corners, self.middles[points.faces], points.barycentric)
        return np.minimum(found, straight_to(self.operators, self.sources, points))

    @cached_property
    def middles(self) -> Float[Array, "f 3"]:
        """Distances of the middles of the mesh's edges, edge i of a face from corner i to corner i + 1."""
        return distances_at_middles(self.operators, self.distances)


def geodesic_distances(
    operators: Operators, points: Float[Array, "n 3"] | Sequence[Sequence[float]], method: GeodesicMethod = "heat"
) -> Geodesics:
    """Distance of every vertex to the nearest source along the surface.

    Args:
        operators: Of the mesh.
        points: At least one; each source is the point of the mesh closest to it.
        method: "heat" is within a percent or so on good meshes, and takes milliseconds once the operators have been
            factorised; "exact" is the distance on the triangles.

    Raises:
        InputError: there is no point, or one is not finite.
    """
    if not len(points):
        raise InputError("geodesic distances need at least one source")
    sources = operators.closest(np.asarray(points, dtype=np.float64))
    missed = 0
    if method == "exact":
        distances, missed = exact_distances(operators, sources)
    else:
        distances = heat_distances(operators, sources)
    unreached = np.unique(operators.components[~np.isfinite(distances)])
    return Geodesics(distances, sources, len(unreached), missed, operators)
