"""Coarse-to-fine sampling of a field near its zero level set.

The band is a set of *blocks* of 2 x 2 x 2 cells, so that the same samples give the level set at full and at half
resolution. It is closed: where the level set leaves a block, the next block is in the band too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.lattice import CORNERS, Lattice, ScalarField, distinct, evaluate
from ndf_core.base_mesh.sampler import Sampler
from ndf_core.errors import BaseMeshError

SAFETY = 1.001
"""On the distance bound, against rounding."""
WHOLE = 64
"""Cells along the longest side of the lattice that is sampled as a whole where there is no distance bound."""
_NEIGHBOURS = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
_SIDES = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])


@dataclass(frozen=True)
class Band:
    """Samples of a field at all corners of the cells near its level set."""

    lattice: Lattice
    blocks: Int[Array, " b"]
    """Keys of cells of width 2, ascending."""
    corners: Int[Array, " n"]
    """Keys of the sampled corners, ascending."""
    values: Float[Array, " n"]
    """Negative inside."""

    def cells(self, width: int) -> Int[Array, "m 3"]:
        """Lowest corners of the cells of width 1 or 2."""
        low = 2 * self.lattice.cell_index(self.blocks, 2)
        return low if width == 2 else (low[:, None] + CORNERS).reshape(-1, 3)

    def at(self, index: Int[Array, "... 3"]) -> Float[Array, "..."]:
        """Values at sampled corners."""
        keys = self.lattice.corner_keys(index.reshape(-1, 3))
        return self.values[np.searchsorted(self.corners, keys)].reshape(index.shape[:-1])


def sample_near_level_set(
    field: ScalarField,
    bounds: Float[Array, "2 3"],
    resolution: int,
    lipschitz: float | None,
    distance: ScalarField | None = None,
    near: Float[Array, "n 3"] | None = None,
) -> Band:
    """Sample `field` where its zero level set can be, on a lattice with `resolution` cells along the longest side.

    With `lipschitz`, no part of the level set is missed: a cell is left out only if the value at its middle says that
    it is farther away than half the diagonal. Without, a lattice of about 64 (45 to 90) cells is sampled as a whole,
    and a part that lies wholly inside one of its cells, connected to nothing that is seen there, is missed. Where
    points `near` the level set are known, it is looked for around these instead, and followed from there.

    Args:
        field: Negative inside; only called within `bounds`.
        lipschitz: ``|field| <= lipschitz * distance to the level set``, or None if nothing of the kind is known.
        distance: The absolute value of `field`, where it is much cheaper without the sign. `field` is then asked for
            the sign of one in about five corners. Needs `lipschitz`.
        near: Points of which each component of the level set passes one within about a cell; only used without
            `lipschitz`.

    Raises:
        BaseMeshError: no negative value; the message has the range of the values.
    """
    widest = 8 if lipschitz is not None else 1 << max(0, round(float(np.log2(resolution / WHOLE))))
    sampler = Sampler(Lattice.over(bounds, resolution, max(2, widest)), field, lipschitz, distance)
    if lipschitz is not None:
        blocks = _by_distance(sampler, lipschitz)
    elif near is not None:
        index = np.floor((near - sampler.lattice.low) / sampler.lattice.step).astype(np.int64) + 1
        blocks = distinct(sampler.lattice.cell_keys(np.clip(index, 0, sampler.lattice.size - 1) // 2, 2))
    elif widest > 1:
        blocks = _by_sign(sampler)
    else:
        blocks = sampler.lattice.cell_keys(_all_cells(sampler.lattice, 2), 2)
    band = _follow(sampler, _sampled(sampler, blocks))
    if not (band.values < 0).any():
        _raise_nothing_found(field, bounds)
    return band


def _by_distance(sampler: Sampler, lipschitz: float) -> Int[Array, " b"]:
    """Blocks that may meet the level set: halve cells, from the widest to width 2, keeping those near enough."""
    lattice = sampler.lattice
    width = lattice.coarsest
    cells = _all_cells(lattice, width)
    while True:
        # The middle of a cell that sticks out of the bounds is moved in, and so comes nearer to all of its inside.
        middle = lattice.positions(np.clip((cells + 0.5) * width, 1, lattice.inner + 1))
        reach = SAFETY * lipschitz * 0.5 * width * lattice.diagonal
        keep = np.abs(evaluate(sampler.distance or sampler.field, middle)) <= reach
        # A cell far from the level set is inside or outside altogether; at the bounds the inside is cut off.
        border = ~keep & ((cells * width <= 1) | ((cells + 1) * width >= lattice.inner + 1)).any(axis=1)
        keep[border] = evaluate(sampler.field, middle[border]) < 0
        cells = cells[keep]
        if width == 2:
            return lattice.cell_keys(cells, width)
        width //= 2
        cells = (2 * cells[:, None] + CORNERS).reshape(-1, 3)
        cells = cells[(cells * width <= lattice.inner + 1).all(axis=1)]


def _by_sign(sampler: Sampler) -> Int[Array, " b"]:
    """Blocks near a sign change: all corners of the widest cells first, then the children of those that have one."""
    lattice = sampler.lattice
    width = lattice.coarsest
    cells = _all_cells(lattice, width)
    while True:
        cells = _with_sign_change(sampler, cells, width)
        # At width 2 the neighbours need not be added: the band is followed from there.
        around = cells if width == 2 else (cells[:, None] + _NEIGHBOURS).reshape(-1, 3)
        around = around[((around >= 0) & (around < lattice.size // width)).all(axis=1)]
        keys = distinct(lattice.cell_keys(around, width))
        if width == 2:
            return keys
        width //= 2
        cells = (2 * lattice.cell_index(keys, 2 * width)[:, None] + CORNERS).reshape(-1, 3)


def _all_cells(lattice: Lattice, width: int) -> Int[Array, "n 3"]:
    x, y, z = (np.arange(n) for n in lattice.size // width)
    return np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)


def _with_sign_change(sampler: Sampler, cells: Int[Array, "n 3"], width: int) -> Int[Array, "m 3"]:
    keys = sampler.lattice.corner_keys(((cells[:, None] + CORNERS) * width).reshape(-1, 3))
    corners, inverse = np.unique(keys, return_inverse=True)
    inside = (sampler.sample(corners) < 0)[inverse].reshape(-1, 8)
    return cells[inside.any(axis=1) & ~inside.all(axis=1)]


def _block_corners(lattice: Lattice, blocks: Int[Array, " b"]) -> Int[Array, " n"]:
    offsets = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    index = (2 * lattice.cell_index(blocks, 2)[:, None] + offsets).reshape(-1, 3)
    return distinct(lattice.corner_keys(index))


def _sampled(sampler: Sampler, blocks: Int[Array, " b"]) -> Band:
    corners = _block_corners(sampler.lattice, blocks)
    return Band(sampler.lattice, distinct(blocks), corners, sampler.sample(corners))


def _follow(sampler: Sampler, band: Band) -> Band:
    """Add the blocks beyond each face of the band through which the level set leaves it, until there is none."""
    fresh = band.blocks
    while len(fresh):
        fresh = _beyond(band, fresh)
        if not len(fresh):
            break
        corners = _block_corners(band.lattice, fresh)
        corners = corners[~np.isin(corners, band.corners, assume_unique=True)]
        keys = np.concatenate([band.corners, corners])
        values = np.concatenate([band.values, sampler.sample(corners)])
        order = np.argsort(keys)
        band = Band(band.lattice, distinct(np.concatenate([band.blocks, fresh])), keys[order], values[order])
    return band


def _beyond(band: Band, blocks: Int[Array, " b"]) -> Int[Array, " m"]:
    """Blocks not in the band that share a face with a sign change with one of `blocks`."""
    index = band.lattice.cell_index(blocks, 2)
    missing: list[Int[Array, " m"]] = []
    for side in _SIDES:
        axis = int(np.flatnonzero(side)[0])
        grid = np.stack(np.meshgrid(*[np.arange(3)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
        face = np.insert(grid, axis, 1 + side[axis], axis=1)
        inside = band.at(2 * index[:, None] + face) < 0
        crossed = index[inside.any(axis=1) & ~inside.all(axis=1)] + side
        keys = band.lattice.cell_keys(crossed, 2)
        missing.append(keys[~np.isin(keys, band.blocks)])
    return distinct(np.concatenate(missing))


def _raise_nothing_found(field: ScalarField, bounds: Float[Array, "2 3"]) -> None:
    coarse = Lattice.over(bounds, 32, 1)
    index = _all_cells(coarse, 1) + 1
    values = evaluate(field, coarse.positions(index[coarse.within(index)]))
    low, high = (", ".join(f"{x:.6g}" for x in corner) for corner in bounds)
    raise BaseMeshError(
        f"the field has no negative value between ({low}) and ({high}), so there is no surface; on a grid of 32 its "
        f"values run from {values.min():.6g} to {values.max():.6g}. Check the bounds, the iso value and which side "
        f"is negative"
    )
