"""STL, binary and text: triangles with corners of their own."""

from __future__ import annotations

import re

import numpy as np

from ndf_core.readers.detect import is_binary_stl, stl_count
from ndf_core.readers.numbers import parse_numbers
from ndf_core.readers.polygons import RawMesh

_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"^\s*vertex\b([^\r\n]*)", re.MULTILINE | re.IGNORECASE)
_FACET = re.compile(rb"^\s*facet\b", re.MULTILINE | re.IGNORECASE)
_END = re.compile(rb"^\s*endfacet\b", re.MULTILINE | re.IGNORECASE)


def read_stl(data: bytes) -> RawMesh:
    """Read a binary STL.

    Raises:
        ValueError: the number of triangles in the header does not fit the file's size.
    """
    if not is_binary_stl(data[:84], len(data)):
        raise ValueError(
            f"the header announces {stl_count(data):,} triangles, {84 + 50 * stl_count(data):,} bytes, "
            f"but the file has {len(data):,}; it is cut off or no STL"
            if len(data) >= 84
            else "it is shorter than the header of an STL file"
        )
    rows = np.frombuffer(data, dtype=_ROW, offset=84)
    return _separate(rows["corners"].astype(np.float64).reshape(-1, 3))


def read_ascii_stl(data: bytes) -> RawMesh:
    """Read a text STL.

    Raises:
        ValueError: a facet is incomplete, or a coordinate is no number.
    """
    corners = parse_numbers(b" ".join(_VERTEX.findall(data)))
    facets = len(_FACET.findall(data))
    if len(_END.findall(data)) != facets or len(corners) != 9 * facets:
        raise ValueError(f"its {facets:,} facets do not have three vertices of three numbers each; it may be cut off")
    return _separate(corners.reshape(-1, 3))


def _separate(corners: np.ndarray) -> RawMesh:
    return RawMesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))
