"""Which mesh format a file is in, from its first and last bytes; standard library only, since `sniff` runs it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ndf_core.readers.ply_header import PlyHeaderError, read_ply_header

Format = Literal["ply", "stl", "ascii stl", "obj", "off", "glb"]

SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb")
_WINDOW = 64 << 10
_STL_HEADER, _STL_TRIANGLE = 84, 50
_OBJ_VERTEX = re.compile(rb"^\s*v[ \t]+[-+.\d]", re.MULTILINE)
_OBJ_FACE = re.compile(rb"^\s*f[ \t]+-?\d", re.MULTILINE)
_OFF = re.compile(rb"\s*(?:#[^\n]*\n\s*)*(?:ST)?C?N?OFF(?:\s|$)")


@dataclass(frozen=True)
class Content:
    """What the first look shows."""

    format: Format | None
    """None where no format fits."""
    has_faces: bool
    """Whether the file says that it has triangles or polygons."""


def look(path: Path) -> Content:
    """Recognise a mesh file by its content.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_WINDOW)
        size = file.seek(0, 2)
        file.seek(max(0, size - _WINDOW))
        tail = file.read(_WINDOW)
    if head[:4] == b"glTF":
        return Content("glb", True)
    if re.match(rb"ply\r?\n", head):
        return Content("ply", _ply_has_faces(head))
    if is_binary_stl(head, size):
        return Content("stl", size > _STL_HEADER)
    if _OFF.match(head):
        return Content("off", True)
    if re.match(rb"\s*solid\b", head) and re.search(rb"\bfacet\b|\bendsolid\b", head):
        return Content("ascii stl", True)
    if b"\0" not in head and _OBJ_VERTEX.search(head):
        # Faces come after vertices as a rule: in the first bytes of a small file, in the last ones of a large file.
        return Content("obj", bool(_OBJ_FACE.search(head) or _OBJ_FACE.search(tail)))
    return Content(None, False)


def is_binary_stl(head: bytes, size: int) -> bool:
    """Whether the triangle count in the header and the file's size agree. (The text of the header means nothing.)"""
    return len(head) >= _STL_HEADER and size == _STL_HEADER + _STL_TRIANGLE * stl_count(head)


def stl_count(head: bytes) -> int:
    """The number of triangles that a binary STL file announces."""
    return int.from_bytes(head[80:84], "little")


def _ply_has_faces(head: bytes) -> bool:
    try:
        elements = read_ply_header(head).elements
    except PlyHeaderError:
        return True  # it will be refused with the fault in its header
    return any(element.name in ("face", "tristrips") and element.count != 0 for element in elements)
