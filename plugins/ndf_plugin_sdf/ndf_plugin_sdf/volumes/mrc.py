"""MRC2014 / CCP4 maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_plugin_sdf.volumes.mrc_header import MrcHeader, read_mrc_header


def read_mrc(path: Path) -> tuple[Array, Float[Array, "4 4"], tuple[str, ...]]:
    """Voxels by x, y, z, the affine from index to the map's units (angstroms), and notes.

    Raises:
        InputError: the file is cut off.
    """
    header = read_mrc_header(path)
    assert header is not None  # `look` has seen it
    try:
        held = path.stat().st_size - header.offset
        if held < header.data_bytes:
            raise InputError(
                f"{path}: cut off: {header.shape} takes {header.data_bytes} bytes, {max(held, 0)} are there"
            )
        with path.open("rb") as file:
            file.seek(header.offset)
            data = file.read(header.data_bytes)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    columns, rows, sections = header.shape
    stored = np.frombuffer(data, np.dtype(header.order + header.dtype)).reshape(sections, rows, columns)
    # Axis of the array, slowest first, that holds x, y and z.
    values = stored.transpose([2 - header.axes.index(axis) for axis in range(3)])
    affine, notes = _affine(header)
    return values.astype(np.float32), affine, notes


def _affine(header: MrcHeader) -> tuple[Float[Array, "4 4"], tuple[str, ...]]:
    """The origin of the header counts; where it is zero, the start indices do (as in CCP4, and in ChimeraX)."""
    notes: tuple[str, ...] = ()
    steps = _cell_vectors(header)
    if steps is None:
        steps = np.eye(3)
        notes = ("its header has no cell: voxels are taken to be of size 1",)
    affine = np.eye(4)
    affine[:3, :3] = steps
    start = np.array([header.start[header.axes.index(axis)] for axis in range(3)], np.float64)
    affine[:3, 3] = header.origin if any(header.origin) else steps @ start
    return affine, notes


def _cell_vectors(header: MrcHeader) -> Float[Array, "3 3"] | None:
    """Steps of one voxel along the cell's axes: a along x, b in the plane of x and y. None where there is no cell."""
    intervals, cell, angles = np.array(header.intervals), np.array(header.cell), np.array(header.angles)
    if not (intervals > 0).all() or not (np.isfinite(cell) & (cell > 0)).all():
        return None
    if not (np.isfinite(angles) & (angles > 0) & (angles < 180)).all():
        angles = np.full(3, 90.0)
    cosine = np.where(angles == 90.0, 0.0, np.cos(np.radians(angles)))
    sine = np.sqrt(1 - cosine[2] ** 2)
    across = (cosine[0] - cosine[1] * cosine[2]) / sine
    upright = np.sqrt(max(0.0, 1 - cosine[1] ** 2 - across**2))
    vectors = np.array([[1.0, cosine[2], cosine[1]], [0.0, sine, across], [0.0, 0.0, upright]])
    return vectors * (cell / intervals)
