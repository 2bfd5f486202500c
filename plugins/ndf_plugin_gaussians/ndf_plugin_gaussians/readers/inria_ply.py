"""The .ply of the original 3D Gaussian splatting code; spherical harmonics of any degree, of which 0 is kept."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.readers.ply_tables import Column, read_ply_tables
from ndf_plugin_gaussians.splats import SH_C0, Splats, make_splats, sigmoid


def read_inria_ply(data: bytes) -> tuple[Splats, int]:
    """Splats, and the number of those left out as not finite.

    Scales are stored as logarithms, opacities before the sigmoid. A colour that is missing is grey.

    Raises:
        ValueError: a column is missing, or the file is no valid PLY.
    """
    vertex = read_ply_tables(data).get("vertex", {})
    count = len(_column(vertex, "x"))
    colours = np.full((count, 3), 0.5)
    if all(f"f_dc_{i}" in vertex for i in range(3)):
        colours = 0.5 + SH_C0 * _columns(vertex, [f"f_dc_{i}" for i in range(3)])
    return make_splats(
        centres=_columns(vertex, ["x", "y", "z"]),
        log_scales=_columns(vertex, [f"scale_{i}" for i in range(3)]),
        quaternions=_columns(vertex, [f"rot_{i}" for i in range(4)]),
        opacities=sigmoid(_column(vertex, "opacity")),
        colours=colours,
    )


def _columns(table: dict[str, Column], names: list[str]) -> Float[Array, "n k"]:
    return np.stack([_column(table, name) for name in names], axis=1)


def _column(table: dict[str, Column], name: str) -> Float[Array, " n"]:
    found = table.get(name)
    if not isinstance(found, np.ndarray):
        raise ValueError(f"there is no column {name!r} in its vertices")
    return found.astype(np.float64)
