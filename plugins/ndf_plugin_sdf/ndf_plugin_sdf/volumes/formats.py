"""Which kind of volume file this is, from its header; standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ndf_core.readers.npy_header import MAGIC, NpyHeaderError, read_npy_header, read_npz_headers
from ndf_plugin_sdf.volumes.mrc_header import MrcHeaderError, read_mrc_header
from ndf_plugin_sdf.volumes.nifti_header import NiftiHeaderError, read_nifti_header

Format = Literal["nifti", "mrc", "npy", "npz"]

SUFFIXES = (".nii", ".nii.gz", ".mrc", ".map", ".ccp4", ".npy", ".npz")


@dataclass(frozen=True)
class VolumeFile:
    """What a first look shows."""

    format: Format
    shape: tuple[int, ...] | None
    """None where the header is faulty, or where there are several arrays to choose from."""
    fault: str | None = None
    """What is wrong with the header."""


def look(path: Path) -> VolumeFile | None:
    """Recognise a volume by its content; None where it is none.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(8)
        if head.startswith(MAGIC):
            file.seek(0)
            try:
                return _volume("npy", read_npy_header(file).shape)
            except NpyHeaderError as error:
                return VolumeFile("npy", None, str(error))
    if head.startswith(b"PK"):
        return _archive(path)
    try:
        nifti = read_nifti_header(path)
        if nifti is not None:
            return VolumeFile("nifti", nifti.shape)
        mrc = read_mrc_header(path)
        return VolumeFile("mrc", mrc.shape) if mrc is not None else None
    except NiftiHeaderError as error:
        return VolumeFile("nifti", None, str(error))
    except MrcHeaderError as error:
        return VolumeFile("mrc", None, str(error))


def _archive(path: Path) -> VolumeFile | None:
    try:
        headers = read_npz_headers(path)
    except NpyHeaderError:
        return None
    volumes = [header.shape for header in headers.values() if is_volume(header.shape)]
    if not volumes:
        return None
    return VolumeFile("npz", volumes[0] if len(volumes) == 1 else None)


def _volume(kind: Format, shape: tuple[int, ...]) -> VolumeFile:
    return VolumeFile(
        kind, shape if is_volume(shape) else None, None if is_volume(shape) else f"its shape is {shape}"
    )


def is_volume(shape: tuple[int, ...]) -> bool:
    """Three sides of at least four voxels, the least that has an inside."""
    return len(shape) == 3 and min(shape) >= 4
