"""A density at the nodes of a grid, asked for only where its level set may pass."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy import ndimage

from ndf_plugin_nerf.density import Density
from ndf_plugin_nerf.lattice import Nodes

_AROUND = np.ones((3, 3, 3), dtype=bool)


def sample_all(density: Density, nodes: Nodes) -> Float[Array, "x y z"]:
    """The density at every node, float32."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in nodes.counts), indexing="ij"), axis=-1).reshape(-1, 3)
    return density.on_arrays(nodes.positions(index)).reshape(nodes.counts)


def sample_near(density: Density, nodes: Nodes, threshold: float) -> tuple[Float[Array, "x y z"], int]:
    """The density at the nodes, exact wherever the level set of `threshold` may be near.

    Every other node is asked first. The others are asked where those around them, one more on each side included, are
    not all on one side of the threshold; elsewhere they are interpolated. What lies between the nodes of the coarse
    grid and touches nothing that they see is missed.

    Returns:
        Values (float32), and how many points were asked for.
    """
    coarse = sample_all(density, nodes.every_other())
    values = _doubled(coarse)
    asked = _near(coarse >= threshold)
    asked[::2, ::2, ::2] = False
    index = np.argwhere(asked)
    values[asked] = density.on_arrays(nodes.positions(index))
    return values, coarse.size + len(index)


def _near(solid: Bool[Array, "x y z"]) -> Bool[Array, "u v w"]:
    """Nodes of the fine grid next to a change of side."""
    mixed = np.logical_and(*(ndimage.binary_dilation(side, _AROUND) for side in (solid, ~solid)))
    near = np.zeros([2 * n - 1 for n in solid.shape], dtype=bool)
    near[::2, ::2, ::2] = mixed
    return np.asarray(ndimage.binary_dilation(near, _AROUND))


def _doubled(values: Float[Array, "x y z"]) -> Float[Array, "u v w"]:
    """Values at twice as many cells along each axis, new ones as means of their neighbours."""
    for axis in range(3):
        moved = np.moveaxis(values, axis, 0)
        finer = np.empty((2 * len(moved) - 1, *moved.shape[1:]), np.float32)
        finer[::2] = moved
        finer[1::2] = 0.5 * (moved[:-1] + moved[1:])
        values = np.moveaxis(finer, 0, axis)
    return np.ascontiguousarray(values)
