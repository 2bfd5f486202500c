"""Arrays from .npy and .npz files, bounded before anything is allocated; never unpickles."""

from __future__ import annotations

import zipfile
import zlib
from io import BufferedIOBase
from pathlib import Path
from typing import IO

import numpy as np
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.readers.npy_header import NpyHeaderError, read_npy_header, read_npz_headers


def read_npy(path: Path, most_bytes: int) -> Array:
    """The array of a .npy file, in native byte order.

    Raises:
        InputError: the file cannot be read, holds no numbers, is cut off, or is larger than `most_bytes`.
    """
    try:
        with path.open("rb") as file:
            # A header that claims more than the file holds must not get that much memory.
            return _read(file, str(path), most_bytes, path.stat().st_size)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error


def read_npz(path: Path, most_bytes: int) -> dict[str, Array]:
    """All arrays of a .npz file by name, in the archive's order and native byte order.

    Raises:
        InputError: as for `read_npy`; the bound is on all arrays together, unpacked.
    """
    try:
        headers = read_npz_headers(path)
        total = sum(header.bytes for header in headers.values())
        if total > most_bytes:
            raise InputError(f"{path}: its arrays take {total} bytes unpacked, more than the {most_bytes} allowed")
        arrays: dict[str, Array] = {}
        with zipfile.ZipFile(path) as archive:
            for name in headers:
                with archive.open(f"{name}.npy") as file:
                    arrays[name] = _read(file, f"{path}: {name}", most_bytes, headers[name].bytes)
        return arrays
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except (NpyHeaderError, zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{path}: {error}") from error


def _read(file: IO[bytes] | BufferedIOBase, origin: str, most_bytes: int, there: int) -> Array:
    """One array; at most about `there` bytes of it are in the file."""
    try:
        header = read_npy_header(file)
    except NpyHeaderError as error:
        raise InputError(f"{origin}: {error}") from error
    if header.bytes > most_bytes:
        raise InputError(f"{origin}: {header.shape} takes {header.bytes} bytes, more than the {most_bytes} allowed")
    data = file.read(min(header.bytes, there))
    if len(data) < header.bytes:
        raise InputError(f"{origin}: cut off: {header.shape} takes {header.bytes} bytes, and {len(data)} are there")
    array = np.frombuffer(data, np.dtype(header.dtype)).reshape(
        header.shape, order="F" if header.fortran_order else "C"
    )
    return array.astype(array.dtype.newbyteorder("="), copy=False)
