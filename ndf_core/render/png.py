"""PNG files from the standard library alone. Reference: PNG (Third Edition), W3C 2025."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import Integer, UInt8
from numpy import ndarray as Array

from ndf_core.files import atomic_write

_COLOR_TYPES = {1: 0, 3: 2, 4: 6}


def write_png(path: Path | str, image: UInt8[Array, "h w *c"]) -> None:
    """Write an 8-bit sRGB picture, (h, w) grey, (h, w, 3) RGB or (h, w, 4) RGBA; appears whole or not at all.

    Raises:
        OutputError: the folder is missing, or a folder is in the file's place.
        ValueError: the array is not such a picture.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.size == 0:
        raise ValueError(f"picture: need uint8 (h, w), (h, w, 3) or (h, w, 4), got {image.dtype} {image.shape}")
    height, width = image.shape[:2]
    channels = 1 if image.ndim == 2 else image.shape[2]
    if channels not in _COLOR_TYPES:
        raise ValueError(f"picture: need 1, 3 or 4 channels, got {channels}")
    header = struct.pack(">IIBBBBB", width, height, 8, _COLOR_TYPES[channels], 0, 0, 0)
    rows = _filtered(image.reshape(height, width, channels))
    with atomic_write(Path(path)) as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in ((b"IHDR", header), (b"sRGB", b"\0"), (b"IDAT", zlib.compress(rows, 7)), (b"IEND", b"")):
            file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))


def _filtered(image: UInt8[Array, "h w c"]) -> bytes:
    """Each row through the filter with the smallest sum of magnitudes, the standard's heuristic (section 12.7)."""
    height = len(image)
    here = image.astype(np.int16)
    left, up, corner = (np.zeros_like(here) for _ in range(3))
    left[:, 1:] = here[:, :-1]
    up[1:] = here[:-1]
    corner[1:, 1:] = here[:-1, :-1]
    predictions = (np.zeros_like(here), left, up, (left + up) // 2, _paeth(left, up, corner))
    candidates = np.stack([(here - prediction).astype(np.uint8).reshape(height, -1) for prediction in predictions])
    best = np.abs(candidates.view(np.int8).astype(np.int32)).sum(axis=2).argmin(axis=0)
    rows = candidates[best, np.arange(height)]
    return np.concatenate([best[:, None].astype(np.uint8), rows], axis=1).tobytes()


def _paeth(
    left: Integer[Array, "h w c"], up: Integer[Array, "h w c"], corner: Integer[Array, "h w c"]
) -> Integer[Array, "h w c"]:
    to_left, to_up, to_corner = np.abs(up - corner), np.abs(left - corner), np.abs(left + up - 2 * corner)
    return np.where((to_left <= to_up) & (to_left <= to_corner), left, np.where(to_up <= to_corner, up, corner))
