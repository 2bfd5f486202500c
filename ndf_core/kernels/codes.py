"""Entropy coding of quantised arrays, the same bytes on every machine: the interface of `src/codes.c`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Int
from ndf_core.kernels import _codes  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub


def encode_codes(arrays: Sequence[Int[Array, "rows columns"]]) -> bytes:
    """Encode arrays of int16 codes, one adaptive scale per column, into one stream.

    Laws: `decode_codes` with the same shapes gives the same codes; equal arrays give equal bytes, on every machine.

    Raises:
        ValueError: an array is empty, or a code is outside the range of int16.
    """
    if not arrays:
        return b""
    codes = np.concatenate([array.astype(np.int32).ravel() for array in arrays])
    shapes = np.array([array.shape for array in arrays], dtype=np.int32)
    buffer = np.empty(7 * len(codes) + 8 * len(arrays) + 16, dtype=np.uint8)
    size = _codes.encode(buffer, codes, shapes)
    return buffer[:size].tobytes()


def decode_codes(data: bytes, shapes: Sequence[tuple[int, int]]) -> list[Int[Array, "rows columns"]]:
    """The arrays (int16) that `encode_codes` made `data` from; the caller bounds the sizes beforehand.

    Other bytes of the right length may decode to something too, so `data` needs a digest of its own against damage.

    Raises:
        ValueError: a shape has no entries, or `data` does not end where the last code does.
    """
    if not shapes:
        if data:
            raise ValueError("the codes do not end where the last array does")
        return []
    sizes = [rows * columns for rows, columns in shapes]
    codes = np.empty(sum(sizes), dtype=np.int32)
    if not _codes.decode(codes, np.frombuffer(data, dtype=np.uint8), np.array(shapes, dtype=np.int32)):
        raise ValueError("the codes do not end where the last array does")
    parts = np.split(codes.astype(np.int16), np.cumsum(sizes)[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]
