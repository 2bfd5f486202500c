"""The header of a PLY file: pure Python, so that looking at a file stays cheap."""

from __future__ import annotations

import re
from dataclasses import dataclass

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
MOST_HEADER_BYTES = 64 << 10
_COUNT = re.compile(r"\d{1,15}")


class PlyHeaderError(ValueError):
    """The header is not one of PLY 1.0, or counts what no file can hold."""


@dataclass(frozen=True)
class Property:
    """A number per row, or a list of numbers."""

    name: str
    type: str
    """numpy's code without byte order, such as "f4"."""
    count_type: str | None = None
    """Type of the list's length; None for a single number."""


@dataclass(frozen=True)
class Element:
    """A table: vertices, faces, ..."""

    name: str
    count: int
    properties: tuple[Property, ...]


@dataclass(frozen=True)
class PlyHeader:
    """Tables in file order, their byte order, and where they begin."""

    byte_order: str | None
    """"<" or ">"; None for text."""
    elements: tuple[Element, ...]
    size: int
    """Bytes before the first table."""


def read_ply_header(head: bytes) -> PlyHeader:
    """Read the header at the start of `head`.

    Raises:
        PlyHeaderError: with what is wrong.
    """
    end = re.search(rb"\nend_header[ \t]*(\r\n|\n|\r)", head[:MOST_HEADER_BYTES])
    if not head.startswith(b"ply") or end is None:
        raise PlyHeaderError("the header has no `end_header`; the file is cut off or no PLY")
    lines = head[: end.start()].decode("latin-1").splitlines()[1:]
    orders = {"format ascii 1.0": None, "format binary_little_endian 1.0": "<", "format binary_big_endian 1.0": ">"}
    order: str | None = "unknown"
    tables: list[tuple[str, int, list[Property]]] = []
    for line in lines:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format":
            order = orders.get(" ".join(words), "unknown")
        elif words[0] == "element" and len(words) == 3:
            if not _COUNT.fullmatch(words[2]):
                raise PlyHeaderError(f"the header announces {words[2]!r:.40} rows of {words[1]!r:.40}")
            tables.append((words[1], int(words[2]), []))
        elif words[0] == "property" and tables:
            tables[-1][2].append(_property(line, words))
        else:
            raise PlyHeaderError(f"the header line {line!r:.80} is not understood")
    if order == "unknown":
        raise PlyHeaderError("the header has no known `format` line")
    return PlyHeader(order, tuple(Element(name, n, tuple(items)) for name, n, items in tables), end.end())


def _property(line: str, words: list[str]) -> Property:
    if len(words) == 3 and words[1] in _TYPES:
        return Property(words[2], _TYPES[words[1]])
    if len(words) == 5 and words[1] == "list" and words[2] in _TYPES and words[3] in _TYPES:
        count_type = _TYPES[words[2]]
        if count_type[0] == "f":
            raise PlyHeaderError(f"the header line {line!r:.80} counts with real numbers")
        return Property(words[4], _TYPES[words[3]], count_type)
    raise PlyHeaderError(f"the header line {line!r:.80} is not understood")
