"""Projection onto the level set of a winding number by tracing rays (Sec. 4.2)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.kernels.winding import WindingTree
from ndf_core.mesh import unit
from ndf_plugin_pointcloud.caps import take_caps
from ndf_plugin_pointcloud.directions import Neighbourhood
from ndf_plugin_pointcloud.landing import Landing, LandingProjector

TOLERANCE = 5e-5
"""The sign change of w - 1/2 is bracketed to this share of the size."""
_REACH = 2.0
"""Rays go so many distances to the nearest sample and ..."""
_SPACINGS = 4.0
"""... so many of its disc's radii: the nearest crossing is no farther, and other ones do not count."""
_AWAY = 3.0
"""Queries so many radii from every sample may be over a hole."""


class TracingProjector(LandingProjector):
    """Traces from each query along the paper's direction to the level set w = 1/2.

    A query whose ray meets nothing goes along the gradient of w instead; what meets nothing then either has not
    converged. Over a hole the paper's direction is that of its rim, and a ray along it ends on the wall behind: there
    the gradient is traced too, and the nearer landing counts. Normals are the gradient of w, outwards.
    """

    def __init__(self, tree: WindingTree, neighbourhood: Neighbourhood, size: float) -> None:
        """Hold the parts.

        Args:
            tree: w.
            neighbourhood: samples of the surface with normals.
            size: longest side of the surface, which the tolerance is a share of.
        """
        self._tree, self._neighbourhood, self._size = tree, neighbourhood, size

    def land(self, query: Float[Array, "n 3"], threads: int = 1) -> Landing:
        near = self._neighbourhood.directions(query, threads)
        reaches = _REACH * near.distances + _SPACINGS * near.spacings
        outwards = near.outwards
        tolerance = TOLERANCE * self._size
        way = self._tree.trace(query, outwards, near.heights, near.spacings, reaches, tolerance, threads)
        lost = np.flatnonzero(np.isnan(way))
        if len(lost):
            slope = unit(-self._tree.values_and_gradients(query[lost], threads)[1])
            unknown, steps = np.zeros(len(lost)), near.spacings[lost]
            way[lost] = self._tree.trace(query[lost], slope, unknown, steps, reaches[lost], tolerance, threads)
            outwards[lost] = slope
        converged = np.isfinite(way)
        found = query + np.where(converged, way, 0.0)[:, None] * outwards
        normals = unit(-self._tree.values_and_gradients(found, threads)[1])
        landing = Landing(found, normals, converged)
        away = np.flatnonzero(near.distances > _AWAY * near.spacings)
        take_caps(landing, query, away, self._tree, self._size, tolerance, threads)
        return landing
