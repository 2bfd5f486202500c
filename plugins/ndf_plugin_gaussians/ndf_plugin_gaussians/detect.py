"""Which splat format a file is in, from its first bytes; standard library only, since `sniff` runs it."""

from __future__ import annotations

import struct
import zipfile
import zlib
from pathlib import Path
from typing import Literal

from ndf_core.readers.ply_header import PlyHeaderError, read_ply_header

Format = Literal["inria ply", "compressed ply", "splat", "spz", "sog", "sog folder"]

SUFFIXES = (".ply", ".splat", ".spz", ".sog")
NAMES: dict[Format, str] = {
    "inria ply": "3DGS .ply",
    "compressed ply": "PlayCanvas compressed .ply",
    "splat": ".splat",
    "spz": ".spz",
    "sog": ".sog",
    "sog folder": ".sog as a folder",
}
SPLAT_ROW = 32
"""Bytes of a splat in a .splat file."""
SPZ_MAGIC = b"NGSP"
_WINDOW = 64 << 10
_INRIA = {"x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"}
_PACKED = {"packed_position", "packed_rotation", "packed_scale", "packed_color"}
_LOOKED_AT = 64
"""Rows of a .splat file whose quaternions are looked at."""


def look(path: Path) -> Format | None:
    """The format, or None where the content is no splats.

    Raises:
        OSError: the file cannot be read.
    """
    if path.is_dir():
        return "sog folder" if (path / "meta.json").is_file() and any(path.glob("*means_l*")) else None
    with path.open("rb") as file:
        head = file.read(_WINDOW)
        size = file.seek(0, 2)
    if head.startswith(b"ply"):
        return _ply(head)
    if head.startswith(SPZ_MAGIC) or _gunzipped(head).startswith(SPZ_MAGIC):
        return "spz"
    if head.startswith(b"PK\3\4"):
        return "sog" if _is_sog(path) else None
    return "splat" if path.suffix.lower() == ".splat" and _is_splat(head, size) else None


def _ply(head: bytes) -> Format | None:
    try:
        elements = {element.name: element for element in read_ply_header(head).elements}
    except PlyHeaderError:
        return None
    vertex = elements.get("vertex")
    columns = {item.name for item in vertex.properties} if vertex else set[str]()
    if columns >= _PACKED and "chunk" in elements:
        return "compressed ply"
    return "inria ply" if columns >= _INRIA else None


def _gunzipped(head: bytes) -> bytes:
    """The first bytes inside a gzip file; empty where it is none."""
    if not head.startswith(b"\x1f\x8b"):
        return b""
    try:
        return zlib.decompressobj(wbits=31).decompress(head, 16)
    except zlib.error:
        return b""


def _is_sog(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            names = {name.rpartition("/")[2] for name in archive.namelist()}
    except (zipfile.BadZipFile, NotImplementedError, ValueError, EOFError, struct.error):
        return path.suffix.lower() == ".sog"  # the reader says what is wrong with it
    return "meta.json" in names and any("means" in name or name.endswith(".webp") for name in names)


def _is_splat(head: bytes, size: int) -> bool:
    """Whole rows, and quaternions in them that are near to unit, as bytes around 128."""
    if size % SPLAT_ROW or len(head) < SPLAT_ROW:
        return False
    rows = min(_LOOKED_AT, len(head) // SPLAT_ROW)
    for row in range(rows):
        parts = [(byte - 128) / 128 for byte in head[SPLAT_ROW * row + 28 : SPLAT_ROW * row + 32]]
        if not 0.8 < sum(part * part for part in parts) < 1.2:
            return False
    return True
