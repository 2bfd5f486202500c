"""Coarse-to-fine sampling of a field near its zero level set.

The band is a set of *blocks* of 2 x 2 x 2 cells, so that the same samples give the level set at full and at half
resolution. It is closed: where the level set leaves a block, the next block is in the band too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
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
_GRID = np.array([[x, y, z] for x in range(3) for y in range(3) for z in range(3)])
"""Offsets of the corners of a block, in the order of `Band.places`."""
_CELLS = {
    1: (CORNERS[:, None] + CORNERS) @ np.array([9, 3, 1]),
    2: (2 * CORNERS[None]) @ np.array([9, 3, 1]),
}
"""The corners of each cell of a block, as rows of `_GRID`, by the width of the cells."""


@dataclass(frozen=True)
class Band:
    """Samples of a field at all corners of the blocks that its level set crosses."""

    lattice: Lattice
    blocks: Int[Array, " b"]
    """Keys of cells of width 2, ascending."""
    corners: Int[Array, " n"]
    """Keys of the sampled corners, ascending."""
    values: Float[Array, " n"]
    """Negative inside."""
    places: Int[Array, "b 27"]
    """Of the corners of each block, in `corners` and `values`."""

    @classmethod
    def of(
        cls, lattice: Lattice, blocks: Int[Array, " b"], corners: Int[Array, " n"], values: Float[Array, " n"]
    ) -> Band:
        """Those of `blocks` (ascending) that have corners inside and outside; all their corners are sampled.

        What is left out has no part of the level set at either resolution, and is most of a band with a loose bound.
        """
        places = _places(lattice, blocks, corners)
        inside = (values < 0)[places]
        crossed = inside.any(axis=1) & ~inside.all(axis=1)
        used = np.zeros(len(corners), dtype=bool)
        used[places[crossed]] = True
        number = np.cumsum(used, dtype=np.int32) - 1
        return cls(lattice, blocks[crossed], corners[used], values[used], number[places[crossed]])

    def crossed_cells(self, width: int) -> tuple[Int[Array, "m 3"], Int[Array, "m 8"]]:
        """Lowest corners of the cells of width 1 or 2 that the level set crosses, and the places of their corners."""
        inside = (self.values < 0)[self.places][:, _CELLS[width]]
        block, cell = np.nonzero(inside.any(axis=2) & ~inside.all(axis=2))
        low = 2 * self.lattice.cell_index(self.blocks[block], 2)
        return low + CORNERS[cell], self.places[block[:, None], _CELLS[width][cell]]


def block_corners(lattice: Lattice, blocks: Int[Array, " b"]) -> Int[Array, " n"]:
    """Keys of the corners of blocks, ascending, each once."""
    return distinct((_lowest(lattice, blocks)[:, None] + lattice.corner_keys(_GRID)).reshape(-1))


def _lowest(lattice: Lattice, blocks: Int[Array, " b"]) -> Int[Array, " b"]:
    """Key of the lowest corner of each block; those of the others are as far from it in every block."""
    return lattice.corner_keys(2 * lattice.cell_index(blocks, 2))


def _places(lattice: Lattice, blocks: Int[Array, " b"], corners: Int[Array, " n"]) -> Int[Array, "b 27"]:
    lowest = _lowest(lattice, blocks)
    places = np.empty((len(blocks), len(_GRID)), dtype=np.int32)
    # One offset after the other, since ascending keys are found several times as fast.
    for i, offset in enumerate(lattice.corner_keys(_GRID)):
        places[:, i] = np.searchsorted(corners, lowest + offset)
    return places


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
    band = _follow(sampler, np.sort(blocks))
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


def _follow(sampler: Sampler, blocks: Int[Array, " b"]) -> Band:
    """The band of `blocks` and of those beyond each face through which the level set leaves it, until none."""
    lattice = sampler.lattice
    corners = block_corners(lattice, blocks)
    band = fresh = Band.of(lattice, blocks, corners, sampler.sample(corners))
    blocks, corners, values = band.blocks, band.corners, band.values
    while len(keys := _beyond(fresh, blocks)):
        around = block_corners(lattice, keys)
        known, place = _find(around, corners)
        sampled = np.empty(len(around))
        sampled[known], sampled[~known] = values[place[known]], sampler.sample(around[~known])
        fresh = Band.of(lattice, keys, around, sampled)
        blocks = np.sort(np.concatenate([blocks, keys]))
        corners = np.concatenate([corners, around[~known]])
        order = np.argsort(corners, kind="stable")
        corners, values = corners[order], np.concatenate([values, sampled[~known]])[order]
    return band if fresh is band else Band.of(lattice, blocks, corners, values)


def _beyond(band: Band, blocks: Int[Array, " n"]) -> Int[Array, " m"]:
    """Keys not among `blocks` of the blocks that share a face with a sign change with one of the band's."""
    inside = (band.values < 0)[band.places]
    index = band.lattice.cell_index(band.blocks, 2)
    missing: list[Int[Array, " m"]] = []
    for side in _SIDES:
        axis = int(np.flatnonzero(side)[0])
        face = inside[:, _GRID[:, axis] == 1 + side[axis]]
        crossed = index[face.any(axis=1) & ~face.all(axis=1)] + side
        keys = band.lattice.cell_keys(crossed, 2)
        missing.append(keys[~_find(keys, blocks)[0]])
    return distinct(np.concatenate(missing))


def _find(keys: Int[Array, " n"], among: Int[Array, " m"]) -> tuple[Bool[Array, " n"], Int[Array, " n"]]:
    """Whether each key is in an ascending array, and where."""
    place = np.searchsorted(among, keys)
    known = np.zeros(len(keys), dtype=bool)
    within = place < len(among)
    known[within] = among[place[within]] == keys[within]
    return known, place


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
