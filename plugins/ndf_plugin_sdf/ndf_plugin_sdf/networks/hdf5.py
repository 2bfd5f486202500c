"""Arrays of an HDF5 file, as Keras writes weights. Follows no link that leaves the file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy import ndarray as Array

from ndf_core.errors import InputError

_MOST_OBJECTS = 4096
_MOST_DEPTH = 16


def read_hdf5(path: Path, most_bytes: int) -> dict[str, Array]:
    """All arrays of real numbers, by path in the file.

    Links to other files, and data kept in other files, are refused; so are arrays that unpack to more than
    `most_bytes`. Nothing is read before all sizes are known.

    Raises:
        InputError: the file is broken, or holds any of these.
    """
    try:
        with h5py.File(path, "r") as file:
            datasets = dict(_datasets(file, "", _MOST_DEPTH, str(path)))
            if len(datasets) > _MOST_OBJECTS:
                raise InputError(f"{path}: holds {len(datasets)} arrays, more than the {_MOST_OBJECTS} allowed")
            # Python's integers: the product of hostile sides must not wrap around.
            total = sum(_product(dataset.shape) * dataset.dtype.itemsize for dataset in datasets.values())
            if total > most_bytes:
                raise InputError(f"{path}: its arrays take {total} bytes, more than the {most_bytes} allowed")
            return {name: np.asarray(dataset[()]) for name, dataset in datasets.items()}
    except InputError:
        raise
    except Exception as error:  # the HDF5 library reports broken files in all kinds
        raise InputError(f"{path}: broken HDF5 file: {' '.join(str(error).split())[:200]}") from error


def _datasets(group: Any, prefix: str, depth: int, origin: str) -> Iterator[tuple[str, Any]]:
    if depth == 0:
        raise InputError(f"{origin}: its groups are nested too deep, at {prefix}")
    for name in group:
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            raise InputError(f"{origin}: {prefix}{name} is a link to somewhere else, which is not followed")
        item = group[name]
        if isinstance(item, h5py.Group):
            # Optimizer states are no weights.
            if not name.startswith("optimizer"):
                yield from _datasets(item, f"{prefix}{name}/", depth - 1, origin)
        elif isinstance(item, h5py.Dataset) and item.shape is not None and item.dtype.kind == "f":
            if item.external or item.is_virtual:
                raise InputError(f"{origin}: the data of {prefix}{name} is in another file, which is not opened")
            yield prefix + name, item


def _product(shape: tuple[int, ...]) -> int:
    product = 1
    for side in shape:
        product *= int(side)
    return product
