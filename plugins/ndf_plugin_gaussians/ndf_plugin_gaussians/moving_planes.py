"""Height above the weighted mean plane of the points of a layer nearby: an implicit moving least squares surface."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_plugin_gaussians.layer import Layer, unit

_NEIGHBOURS = 16
_WIDTH = 0.9
"""Standard deviation of the weights, in cells of the layer, at least."""
_WIDTH_AFAR = 0.4
"""The same, as a share of the distance to the nearest point, where that is more."""
_FACING = 0.2
"""Points of the layer whose normal has a smaller cosine with the guide's belong to another side."""


class MovingPlanes:
    """The mean normal n and the height sum w_i n . (x - p_i) / sum w_i of a point x, with the weights
    w_i = opacity * facing * exp(-|x - p_i|^2 / 2 h^2) of the nearest points of a layer, faded out towards the last.

    "Facing" fades out points whose normals turn away from the outward direction of the solid at x, so that the front
    of a thin part is not drawn to its back. Rows are independent.

    Reference: Kolluri, Provably good moving least squares, 2008.
    """

    def __init__(self, layer: Layer) -> None:
        self.layer = layer
        self._tree = KDTree(layer.points)
        self._ranks = np.arange(1, min(_NEIGHBOURS, len(layer.points)) + 1)

    def at(
        self, points: Float[Array, "n 3"], guide: Float[Array, "n 3"]
    ) -> tuple[Float[Array, " n"], Float[Array, "n 3"], Bool[Array, " n"]]:
        """Height (0 where not known), unit normal, and whether any of the nearest points faces the way of `guide`."""
        layer = self.layer
        distance, index = self._tree.query(
            points,
            k=self._ranks,  # pyright: ignore[reportArgumentType]  # takes ranks too
            workers=torch.get_num_threads(),
        )
        normals = layer.normals[index]
        facing = np.clip((np.einsum("nkx,nx->nk", normals, guide) - _FACING) / (1.0 - _FACING), 0.0, 1.0)
        # The nearest point that faces this way sets the scale; subtracting it keeps the weights from underflow.
        nearest = np.where(facing > 0, distance, np.inf).min(axis=1, initial=np.inf)
        known = np.isfinite(nearest)
        nearest = np.where(known, nearest, 0.0)[:, None]
        width = np.maximum(_WIDTH * layer.spacing, _WIDTH_AFAR * nearest)
        weights = layer.weights[index] * facing * np.exp((nearest**2 - distance**2) / (2.0 * width**2))
        # Down to zero at the last neighbour, or the surface would jump where another point becomes the last one.
        weights *= (1.0 - (distance / np.maximum(distance[:, -1:], 1e-300)) ** 2) ** 2
        mean = unit(np.einsum("nk,nkx->nx", weights, normals))
        offset = np.einsum("nkx,nx->nk", points[:, None] - layer.points[index], mean)
        total = weights.sum(axis=1)
        known &= total > 0
        return np.einsum("nk,nk->n", weights, offset) / np.where(known, total, 1.0), mean, known
