"""The level set of a sampled band as triangles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.cube_cases import EDGES, case_triangles
from ndf_core.base_mesh.lattice import Lattice, ScalarField, evaluate
from ndf_core.base_mesh.narrow_band import Band

MARGIN = 1e-3
"""Crossings stay this share of an edge away from its ends, so that no triangle loses its area ..."""
APART = 6e-5
"""... and this share of the longest side, four steps of 16 bits: what is nearer than that could not be stored."""
MOST = 0.1
"""Of an edge, whatever the resolution."""


def marching_cubes(
    band: Band, width: int = 1, field: ScalarField | None = None, bisections: int = 0
) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"]]:
    """Triangulate the zero level set of a band; zero counts as outside.

    Laws: the mesh is closed and manifold, and its normals point to where the field is positive; the result depends
    on the arguments alone.

    Args:
        width: 1 for the full resolution of the band, 2 for half of it.
        field: Evaluated again along the crossed edges if `bisections` is positive; for fields that are far from
            linear between samples, such as an occupancy.
        bisections: Halvings of each crossed edge before the crossing is interpolated.

    Returns:
        Vertices (float64, input units) and faces (int32).
    """
    low, corners = band.crossed_cells(width)
    case = (band.values[corners] < 0) @ (1 << np.arange(8))
    table, counts = case_triangles()
    edges = table[case][np.arange(table.shape[1]) < counts[case][:, None]].reshape(-1)
    cell = np.repeat(np.arange(len(low)), 3 * counts[case])
    # An edge is named by its lower corner and its axis.
    ends = corners[cell[:, None], np.array(EDGES)[edges]]
    _, first, faces = np.unique(band.corners[ends[:, 0]] * 3 + edges // 4, return_index=True, return_inverse=True)
    vertices = _crossings(band, ends[first], edges[first] // 4, width, field, bisections)
    return vertices, faces.reshape(-1, 3).astype(np.int32)


def _crossings(
    band: Band,
    places: Int[Array, "v 2"],
    axis: Int[Array, " v"],
    width: int,
    field: ScalarField | None,
    bisections: int,
) -> Float[Array, "v 3"]:
    """Points on edges, given by the places of their ends in the band."""
    start = band.lattice.corner_index(band.corners[places[:, 0]])
    step = np.zeros(start.shape, dtype=np.int64)
    step[np.arange(len(axis)), axis] = width
    ends = band.values[places.T]
    share = np.stack([np.zeros(len(axis)), np.ones(len(axis))])
    if field is not None:
        for _ in range(bisections):
            _halve(field, band.lattice, start, step, share, ends)
    # Beyond the bounds the value is infinite: the crossing goes to the end inside, where the cap is.
    finite = np.isfinite(ends).all(axis=0)
    near = np.where(np.isfinite(ends[0]), 0.0, 1.0)
    part = np.divide(ends[0], ends[0] - ends[1], out=near, where=finite)
    part = share[0] + part * (share[1] - share[0])
    margin = min(max(MARGIN, APART * int(band.lattice.inner.max()) / width), MOST)
    return band.lattice.positions(start + np.clip(part, margin, 1 - margin)[:, None] * step)


def _halve(
    field: ScalarField,
    lattice: Lattice,
    start: Int[Array, "v 3"],
    step: Int[Array, "v 3"],
    share: Float[Array, "2 v"],
    ends: Float[Array, "2 v"],
) -> None:
    """Replace, in place, the end of each interval that has the sign of the middle. Edges to the outside stay."""
    rows = np.flatnonzero(np.isfinite(ends).all(axis=0))
    middle = share[:, rows].mean(axis=0)
    values = evaluate(field, lattice.positions(start[rows] + middle[:, None] * step[rows]))
    side = np.where((values < 0) == (ends[0, rows] < 0), 0, 1)
    share[side, rows], ends[side, rows] = middle, values
