"""The fixed part of a NIfTI-1 or NIfTI-2 header; standard library only, since `sniff` runs it."""

from __future__ import annotations

import gzip
import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

_BITS = {2: 8, 4: 16, 8: 32, 16: 32, 64: 64, 256: 8, 512: 16, 768: 32, 1024: 64, 1280: 64}
"""Of the data types that are real numbers, by code."""
_MOST_OFFSET = 1 << 20
"""Extensions between header and voxels are skipped; more of them than this is refused."""


class NiftiHeaderError(ValueError):
    """It is a NIfTI file, and one that cannot be read as a scalar volume."""


@dataclass(frozen=True)
class NiftiHeader:
    """What has to be known before the voxels are read."""

    version: int
    shape: tuple[int, int, int]
    voxel_bytes: int

    @property
    def count(self) -> int:
        return math.prod(self.shape)


def read_nifti_header(path: Path) -> NiftiHeader | None:
    """The header of a .nii or .nii.gz file; None where it is neither.

    Raises:
        OSError: the file cannot be read.
        NiftiHeaderError: it is no volume of real numbers.
    """
    with path.open("rb") as file:
        head = file.read(540)
    if head[:2] == b"\x1f\x8b":
        try:
            with gzip.open(path) as unpacked:
                head = unpacked.read(540)
        except (zlib.error, EOFError, gzip.BadGzipFile):
            return None
    for order in ("<", ">"):
        if len(head) >= 348 and struct.unpack_from(f"{order}i", head)[0] == 348 and head[344:348] == b"n+1\0":
            dims = struct.unpack_from(f"{order}8h", head, 40)
            code, bits = struct.unpack_from(f"{order}2h", head, 70)
            return _checked(1, dims, code, bits, struct.unpack_from(f"{order}f", head, 108)[0])
        if len(head) == 540 and struct.unpack_from(f"{order}i", head)[0] == 540 and head[4:8] == b"n+2\0":
            dims = struct.unpack_from(f"{order}8q", head, 16)
            code, bits = struct.unpack_from(f"{order}2h", head, 12)
            return _checked(2, dims, code, bits, float(struct.unpack_from(f"{order}q", head, 168)[0]))
    return None


def _checked(version: int, dims: tuple[int, ...], code: int, bits: int, offset: float) -> NiftiHeader:
    if not 3 <= dims[0] <= 7 or any(not 0 < side < 1 << 20 for side in dims[1:4]):
        raise NiftiHeaderError(f"its dimensions are {dims}; need three")
    if any(side != 1 for side in dims[4 : dims[0] + 1]):
        raise NiftiHeaderError(f"its dimensions are {dims[1 : dims[0] + 1]}: a series; save one volume of it")
    if _BITS.get(code) != bits:
        raise NiftiHeaderError(f"its voxels are of type {code} with {bits} bits, not real numbers")
    if not 0 <= offset <= _MOST_OFFSET:  # also refuses what is not a number
        raise NiftiHeaderError(f"its voxels begin at byte {offset:g}")
    return NiftiHeader(version, (dims[1], dims[2], dims[3]), bits // 8)
