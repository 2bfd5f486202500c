"""Projection onto the level set of a winding number by tracing rays (Sec. 4.2)."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector
from ndf_core.kernels.winding import WindingTree
from ndf_plugin_pointcloud.directions import Neighbourhood

TOLERANCE = 5e-5
"""The sign change of w - 1/2 is bracketed to this share of the size."""
_REACH = 2.0
"""Rays go so many distances to the nearest sample and ..."""
_SPACINGS = 4.0
"""... so many of its disc's radii: the nearest crossing is no farther, and other ones do not count."""


class TracingProjector(Projector):
    """Traces from each query along the paper's direction to the level set w = 1/2.

    A query far from all samples (over a hole) and one whose ray meets nothing goes along the gradient of w instead.
    What meets nothing then either is not converged. Normals are the gradient of w, outwards.

    Runs in double precision on the CPU; queries on another device are copied there and back. Uses as many threads as
    torch does.
    """

    def __init__(self, tree: WindingTree, neighbourhood: Neighbourhood, size: float) -> None:
        """Hold the parts.

        Args:
            tree: w.
            neighbourhood: samples of the surface with normals.
            size: longest side of the surface, which the tolerance is a share of.
        """
        self._tree, self._neighbourhood, self._size = tree, neighbourhood, size

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        query = points.detach().to("cpu", torch.float64).numpy()
        finite = np.isfinite(query).all(axis=1)
        if not finite.all():
            raise InputError(f"cannot project query point {int((~finite).argmax())}: a coordinate is not finite")
        found, normals, converged = self.land(query, torch.get_num_threads())
        return Projection(
            torch.from_numpy(found).to(points),
            torch.from_numpy(converged).to(points.device),
            torch.from_numpy(normals).to(points),
        )

    def land(
        self, query: Float[Array, "n 3"], threads: int = 1
    ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"], Bool[Array, " n"]]:
        """Landing points, normals there, and which rows landed; the others stay where they are."""
        near = self._neighbourhood.directions(query, threads)
        reaches = _REACH * near.distances + _SPACINGS * near.spacings
        outwards = near.outwards
        way = self._tree.trace(query, outwards, near.heights, near.spacings, reaches, TOLERANCE * self._size, threads)
        lost = np.flatnonzero(np.isnan(way))
        if len(lost):
            slope = _unit(-self._tree.values_and_gradients(query[lost], threads)[1])
            again = (reaches[lost], near.spacings[lost])
            way[lost] = self._tree.trace(
                query[lost], slope, 0 * again[0], again[1], again[0], TOLERANCE * self._size, threads
            )
            outwards[lost] = slope
        converged = np.isfinite(way)
        found = query + np.where(converged, way, 0.0)[:, None] * outwards
        normals = _unit(-self._tree.values_and_gradients(found, threads)[1])
        return found, normals, converged


def _unit(vectors: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
