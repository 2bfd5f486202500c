"""Arrays of a glTF file: accessors on views of the binary chunk, every offset checked before it is used."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy import ndarray as Array

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class Buffer:
    """The binary chunk and the tables that say what lies where in it."""

    def __init__(self, document: dict[str, Any], binary: bytes) -> None:
        self.binary = binary
        self.accessors: Any = document.get("accessors", [])
        self.views: Any = document.get("bufferViews", [])


def read_accessor(buffer: Buffer, index: object, shape: str) -> Array:
    """The numbers of an accessor: (n,) for "SCALAR", (n, 3) for "VEC3"; normalised integers as real numbers.

    Raises:
        ValueError: it is of another shape, reaches beyond the chunk, or is stored in a way that is not read here.
    """
    accessor = _entry(buffer.accessors, index, "accessor")
    if accessor.get("type") != shape or accessor.get("componentType") not in _COMPONENTS:
        raise ValueError(f"accessor {index} is not of type {shape}")
    if "sparse" in accessor or "bufferView" not in accessor:
        raise ValueError(f"accessor {index} is sparse, which is not read; export it plainly")
    view = _entry(buffer.views, accessor["bufferView"], "view")
    if view.get("buffer", 0) != 0 or "extensions" in view:
        raise ValueError("its data are compressed or in another file; export it as one plain .glb")
    kind = np.dtype(_COMPONENTS[accessor["componentType"]])
    width = _WIDTHS[shape]
    count = _size(accessor.get("count", -1), "count")
    offset = _size(view.get("byteOffset", 0), "offset") + _size(accessor.get("byteOffset", 0), "offset")
    stride = _size(view.get("byteStride", kind.itemsize * width), "stride")
    if stride < kind.itemsize * width:
        raise ValueError(f"the rows of accessor {index} overlap")
    if count and offset + (count - 1) * stride + kind.itemsize * width > len(buffer.binary):
        raise ValueError(f"accessor {index} announces {count:,} rows, more than the file holds")
    rows = np.ndarray((count, width), kind, buffer.binary, offset if count else 0, (stride, kind.itemsize))
    numbers = rows.reshape(-1) if shape == "SCALAR" else rows
    if accessor.get("normalized") and kind.kind in "iu":
        return np.maximum(numbers / float(np.iinfo(kind).max), -1.0)
    return numbers


def accessor_shape(buffer: Buffer, index: object) -> str:
    """ "SCALAR", "VEC3", ... as the accessor says.

    Raises:
        ValueError: there is no such accessor.
    """
    return str(_entry(buffer.accessors, index, "accessor").get("type"))


def accessor_count(buffer: Buffer, index: object) -> int:
    """How many rows an accessor announces.

    Raises:
        ValueError: there is no such accessor, or its count is no number.
    """
    return _size(_entry(buffer.accessors, index, "accessor").get("count", -1), "count")


def _entry(table: Any, index: object, name: str) -> dict[str, Any]:
    if not isinstance(table, list) or type(index) is not int or not 0 <= index < len(table):
        raise ValueError(f"there is no {name} {index!r:.40}")
    entry = table[index]
    if not isinstance(entry, dict):
        raise ValueError(f"{name} {index} is not a table")
    return entry


def _size(value: object, name: str) -> int:
    if type(value) is not int or not 0 <= value < 2**48:
        raise ValueError(f"{value!r:.40} is no {name}")
    return value
