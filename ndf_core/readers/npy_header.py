"""What .npy and .npz files say about their arrays; standard library only, since `sniff` runs it."""

from __future__ import annotations

import ast
import math
import re
import zipfile
import zlib
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from typing import IO, Any

MAGIC = b"\x93NUMPY"
_LONGEST = 64 << 10
_MOST_MEMBERS = 4096
_NUMBERS = re.compile(r"[<>|=]?(?:f[248]|[iu][1248]|b1)")


class NpyHeaderError(ValueError):
    """The header is no header of an array of numbers."""


@dataclass(frozen=True)
class NpyHeader:
    """Shape and type of an array, as its header has them."""

    shape: tuple[int, ...]
    dtype: str
    """As numpy writes it: ``"<f4"``. Real numbers, integers or truth values; never objects."""
    fortran_order: bool

    @property
    def count(self) -> int:
        return math.prod(self.shape)

    @property
    def bytes(self) -> int:
        return self.count * int(self.dtype[-1])


def read_npy_header(file: IO[bytes] | BufferedIOBase) -> NpyHeader:
    """Read the header at the file's position; what follows it is the array.

    Raises:
        NpyHeaderError: it is none, or not of an array of numbers.
    """
    start = file.read(8)
    if start[:6] != MAGIC or len(start) < 8 or start[6] not in (1, 2, 3):
        raise NpyHeaderError("it does not begin as a .npy file")
    size = int.from_bytes(file.read(2 if start[6] == 1 else 4), "little")
    if size > _LONGEST:
        raise NpyHeaderError(f"its header is {size} bytes long")
    text = file.read(size)
    try:
        fields: Any = ast.literal_eval(text.decode("latin-1").strip())
        shape, dtype, fortran = fields["shape"], fields["descr"], fields["fortran_order"]
    except (ValueError, SyntaxError, KeyError, TypeError, RecursionError, MemoryError) as error:
        raise NpyHeaderError("its header cannot be read") from error
    if not isinstance(dtype, str) or not _NUMBERS.fullmatch(dtype):
        raise NpyHeaderError(f"it holds {dtype!r:.40}, not numbers")
    if not isinstance(shape, tuple) or not all(type(side) is int and 0 <= side < 1 << 40 for side in shape):
        raise NpyHeaderError(f"its shape is {shape!r:.60}")
    return NpyHeader(shape, dtype, bool(fortran))


def read_npz_headers(path: Path) -> dict[str, NpyHeader]:
    """The header of every array in an archive, by name; none of the arrays is read.

    Raises:
        OSError: the file cannot be read.
        NpyHeaderError: it is no archive of arrays of numbers.
    """
    headers: dict[str, NpyHeader] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > _MOST_MEMBERS:
                raise NpyHeaderError(f"it has {len(members)} members")
            for member in members:
                if not member.filename.endswith(".npy"):
                    raise NpyHeaderError(f"its member {member.filename!r:.60} is no array")
                with archive.open(member) as file:
                    headers[member.filename.removesuffix(".npy")] = _sized(read_npy_header(file), member)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise NpyHeaderError(f"it is no readable zip archive: {error}") from error
    return headers


def _sized(header: NpyHeader, member: zipfile.ZipInfo) -> NpyHeader:
    if header.bytes > member.file_size:
        raise NpyHeaderError(f"{member.filename} says {header.shape}, {header.bytes} bytes, and has fewer")
    return header
