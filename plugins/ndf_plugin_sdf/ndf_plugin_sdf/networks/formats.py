"""Which kind of weight file this is, from its first bytes and its list of members; standard library only."""

from __future__ import annotations

import json
import pickletools
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ndf_core.readers.npy_header import NpyHeaderError, read_npz_headers

Format = Literal["npz", "safetensors", "hdf5", "checkpoint", "program"]

SUFFIXES = (".npz", ".safetensors", ".h5", ".hdf5", ".keras", ".pt2", ".pt", ".pth", ".ckpt")
HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_LONGEST_HEADER = 16 << 20
_LONGEST_PICKLE = 4 << 20


@dataclass(frozen=True)
class WeightFile:
    """What a first look shows."""

    format: Format
    shapes: dict[str, tuple[int, ...]] | None
    """Of the arrays, by name; None where only opening the file would tell."""
    names: tuple[str, ...] = ()
    """Of a checkpoint: all names in it."""


def look(path: Path) -> WeightFile | None:
    """Recognise a file of weights by its content; None where it is none.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(64)
    if head.startswith(HDF5_MAGIC):
        return WeightFile("hdf5", None)
    if head.startswith(b"PK"):
        return _zip(path)
    if head[:2] == b"\x80\x02" and b"\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19." in head:  # torch's old magic number, pickled
        return WeightFile("checkpoint", None)
    return _safetensors(path, head)


def _zip(path: Path) -> WeightFile | None:
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            pickled = next((name for name in names if name == "data.pkl" or name.endswith("/data.pkl")), None)
            if pickled is not None:
                with archive.open(pickled) as file:
                    return WeightFile("checkpoint", None, _names_in(file.read(_LONGEST_PICKLE)))
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError):
        return None
    if any(name == "archive_format" or name.endswith("/archive_format") for name in names):
        return WeightFile("program", None)
    if any(name.endswith(".npy") for name in names):
        try:
            headers = read_npz_headers(path)
        except NpyHeaderError:
            return WeightFile("npz", None)
        return WeightFile("npz", {name: header.shape for name, header in headers.items()})
    return None


def _names_in(pickled: bytes) -> tuple[str, ...]:
    """The strings in a pickle, read as a list of instructions; nothing of it is carried out."""
    names: list[str] = []
    try:
        for _, argument, _ in pickletools.genops(pickled):
            if isinstance(argument, str):
                names.append(argument)
    except (ValueError, IndexError, KeyError, OverflowError, UnicodeDecodeError):
        pass  # cut off or broken: what was found so far will do for a first look
    return tuple(names)


def _safetensors(path: Path, head: bytes) -> WeightFile | None:
    size = int.from_bytes(head[:8], "little")
    if len(head) < 10 or head[8:9] != b"{" or not 2 <= size <= min(_LONGEST_HEADER, path.stat().st_size - 8):
        return None
    with path.open("rb") as file:
        file.seek(8)
        text = file.read(size)
    try:
        header: Any = json.loads(text)
        shapes = {name: tuple(entry["shape"]) for name, entry in header.items() if name != "__metadata__"}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    return WeightFile("safetensors", shapes)
