"""Values of fields from files: arrays of an .npz, or further columns of a .ply."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.readers.numpy_arrays import read_npz
from ndf_core.readers.ply import triangles_of
from ndf_core.readers.ply_tables import read_ply_tables

_MOST_BYTES = 2 << 30
_PLACES = ("points", "vertices")
_PLAIN = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha"}


class ValuesFile(NamedTuple):
    """Where values are and what they are."""

    points: Float[Array, "n 3"]
    faces: Int[Array, "f 3"] | None
    values: Array
    """One row for each point, or each face."""
    names: tuple[str, ...]
    """Of the columns, where the file has them."""


def read_values(path: Path, names: Sequence[str] = ()) -> ValuesFile:
    """Read points, or a mesh, with values.

    Args:
        path: An .npz with `vertices` and `faces`, or `points`, and the values; or a .ply.
        names: The arrays, or the .ply's properties, to read, side by side. Without them, the only array that has a
            row for each point or face; or all properties but coordinates, normals and colours.

    Raises:
        InputError: the file cannot be read, or it is not clear from it what the values are.
    """
    if path.suffix.lower() == ".ply":
        return _from_ply(path, names)
    if path.suffix.lower() != ".npz":
        raise InputError(f"{path}: values are read from .npz and .ply files")
    arrays = read_npz(path, _MOST_BYTES)
    places = [name for name in _PLACES if name in arrays]
    if not places:
        raise InputError(f"{path}: has no array `points`, nor `vertices` and `faces`; it has {', '.join(arrays)}")
    points = arrays[places[0]]
    faces = arrays.get("faces") if places[0] == "vertices" else None
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise InputError(f"{path}: `{places[0]}` has the shape {points.shape}, not (n, 3)")
    lengths = {len(points), len(points) if faces is None else len(faces)}
    fitting = [
        name
        for name, array in arrays.items()
        if name not in (*_PLACES, "faces", "base_faces", "base_barycentric") and array.ndim and len(array) in lengths
    ]
    chosen = list(names) or fitting
    if not chosen:
        others = [f"{name} {array.shape}" for name, array in arrays.items() if name not in (*_PLACES, "faces")]
        raise InputError(
            f"{path}: no array has a row for each point or face ({', '.join(map(str, sorted(lengths)))}); "
            f"there is {', '.join(others) or 'nothing else'}"
        )
    if not names and len(chosen) > 1:
        raise InputError(f"{path}: name the values with --values; there are {', '.join(fitting)}")
    missing = [name for name in chosen if name not in arrays]
    if missing:
        raise InputError(f"{path}: has no array {missing[0]!r}; it has {', '.join(arrays)}")
    values = [arrays[name] for name in chosen]
    if len(values) == 1:
        return ValuesFile(points.astype(np.float64), faces, values[0], ())
    if any(value.ndim != 1 or len(value) != len(values[0]) for value in values):
        raise InputError(f"{path}: several arrays of values must be of one dimension and of one length")
    return ValuesFile(points.astype(np.float64), faces, np.stack(values, axis=1), tuple(chosen))


def _from_ply(path: Path, names: Sequence[str]) -> ValuesFile:
    try:
        tables = read_ply_tables(path.read_bytes())
        faces, _ = triangles_of(tables)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path}: cannot be read as ply: {error}") from error
    columns = {name: column for name, column in tables.get("vertex", {}).items() if isinstance(column, np.ndarray)}
    if not {"x", "y", "z"} <= columns.keys():
        raise InputError(f"{path}: there are no vertices with x, y and z")
    chosen = list(names) or [name for name in columns if name not in _PLAIN]
    missing = [name for name in chosen if name not in columns]
    if missing:
        raise InputError(f"{path}: has no property {missing[0]!r}; it has {', '.join(columns)}")
    if not chosen:
        raise InputError(f"{path}: has no values; its vertices have {', '.join(columns)} alone")
    points = np.stack([np.asarray(columns[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    values = np.stack([np.asarray(columns[name]) for name in chosen], axis=1)
    return ValuesFile(points, faces if len(faces) else None, values, tuple(chosen))
