"""The point cloud library's PCD files: text, binary, and binary compressed."""

from __future__ import annotations

import re

import numpy as np
from numpy import ndarray as Array

from ndf_core.readers.numbers import parse_numbers
from ndf_plugin_pointcloud.lzf import decompress

_TYPES = {"F": "f", "I": "i", "U": "u"}
_DATA = re.compile(rb"^[ \t]*DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE | re.IGNORECASE)
_MOST_HEADER_BYTES = 64 << 10


def read_pcd(data: bytes) -> tuple[Array, Array | None]:
    """Points, and normals where there are the fields normal_x, normal_y and normal_z.

    Raises:
        ValueError: the header is not understood, or the file holds less than it says.
    """
    found = _DATA.search(data[:_MOST_HEADER_BYTES])
    if found is None:
        raise ValueError("the header has no DATA line; it is cut off or no PCD")
    header: dict[str, list[str]] = {}
    for line in data[: found.start()].decode("latin-1").splitlines():
        words = line.split()
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
    names, types, counts = _fields(header)
    points = _count(header)
    body, mode = data[found.end() :], found[1].lower()
    if mode == b"ascii":
        columns = _text(body, sum(counts), points)
        starts = np.cumsum([0, *counts[:-1]])
        table = {name: columns[:, start] for name, start in zip(names, starts, strict=True)}
    elif mode in (b"binary", b"binary_compressed"):
        table = _binary(body, names, types, counts, points, mode == b"binary_compressed")
    else:
        raise ValueError(f"DATA {mode.decode('latin-1')} is not one of ascii, binary, binary_compressed")
    if not {"x", "y", "z"} <= table.keys():
        raise ValueError("there are no fields x, y and z")
    place = np.stack([np.asarray(table[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    parts = [f"normal_{axis}" for axis in "xyz"]
    if not set(parts) <= table.keys():
        return place, None
    return place, np.stack([np.asarray(table[part], dtype=np.float64) for part in parts], axis=1)


def _fields(header: dict[str, list[str]]) -> tuple[list[str], list[str], list[int]]:
    """Names, numpy types and repetitions of the fields."""
    names = header.get("FIELDS", [])
    sizes, kinds = header.get("SIZE", []), header.get("TYPE", [])
    counts = header.get("COUNT", ["1"] * len(names))
    if not names or not len(names) == len(sizes) == len(kinds) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT do not have one entry for each field")
    types: list[str] = []
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        known = kind in _TYPES and size in ("1", "2", "4", "8") and not (kind == "F" and size in ("1", "2"))
        if not known or not re.fullmatch(r"\d{1,4}", count) or count == "0":
            raise ValueError(f"field {name!r:.40} has type {kind:.10}, size {size:.10} and count {count:.10}")
        types.append(f"<{_TYPES[kind]}{size}")
    return names, types, [int(count) for count in counts]


def _count(header: dict[str, list[str]]) -> int:
    words = header.get("POINTS") or [
        str(int(header["WIDTH"][0]) * int(header["HEIGHT"][0]))
        if all(re.fullmatch(r"\d{1,9}", (header.get(name) or [""])[0]) for name in ("WIDTH", "HEIGHT"))
        else ""
    ]
    if not re.fullmatch(r"\d{1,15}", words[0]):
        raise ValueError(f"the header announces {words[0]!r:.40} points")
    return int(words[0])


def _text(body: bytes, width: int, points: int) -> Array:
    numbers = parse_numbers(body)
    if len(numbers) < width * points:
        raise ValueError(f"it announces {points:,} points but has numbers for {len(numbers) // width:,}")
    return numbers[: width * points].reshape(points, width)


def _binary(
    body: bytes, names: list[str], types: list[str], counts: list[int], points: int, compressed: bool
) -> dict[str, Array]:
    """Columns of the first entry of each field; compressed files hold field after field, the others row after row."""
    kinds = [np.dtype((kind, (count,))) for kind, count in zip(types, counts, strict=True)]
    size = points * sum(kind.itemsize for kind in kinds)
    if compressed:
        if len(body) < 8:
            raise ValueError("it ends before the compressed points")
        packed, unpacked = (int(n) for n in np.frombuffer(body, "<u4", 2))
        if packed > len(body) - 8 or unpacked < size:
            raise ValueError(f"it announces {points:,} points, {packed:,} bytes packed and {unpacked:,} unpacked")
        body = decompress(body[8 : 8 + packed], unpacked)
    elif len(body) < size:
        raise ValueError(f"it announces {points:,} points, {size:,} bytes, but has {len(body):,}; it is cut off")
    table: dict[str, Array] = {}
    if compressed:
        start = 0
        for name, kind in zip(names, kinds, strict=True):
            table[name] = np.frombuffer(body, kind.base, points * kind.shape[0], start).reshape(points, -1)[:, 0]
            start += points * kind.itemsize
        return table
    row = np.dtype([(f"{i}", kind) for i, kind in enumerate(kinds)])
    rows = np.frombuffer(body, row, points)
    return {name: rows[f"{i}"][:, 0] for i, name in enumerate(names)}
