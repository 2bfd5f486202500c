"""The tables of a PLY file, text or binary: named columns of numbers, or of lists of numbers."""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from ndf_core.readers.numbers import as_indices, parse_numbers
from ndf_core.readers.ply_header import Element, read_ply_header

Column = Array | tuple[Array, Array]
"""One number per row; or for lists their lengths and all their items in a row."""


def read_ply_tables(data: bytes) -> dict[str, dict[str, Column]]:
    """Every element of the file with its columns by name. Nothing is allocated for rows before they are known to be
    there.

    Raises:
        ValueError: the file is not valid PLY or holds less than its header says.
    """
    header = read_ply_header(data)
    body = data[header.size :]
    reader = _Binary(body, header.byte_order) if header.byte_order else _Text(body)
    tables: dict[str, dict[str, Column]] = {}
    for element in header.elements:
        if not element.properties and element.count:
            raise ValueError(f"the header announces {element.count:,} rows of {element.name!r} without content")
        try:
            tables[element.name] = reader.table(element)
        except EOFError as error:
            raise ValueError(f"the file ends inside its {element.count:,} rows of {element.name!r}") from error
    return tables


class _Binary:
    """Tables of a binary file, one after the other."""

    def __init__(self, body: bytes, order: str) -> None:
        self._body, self._order, self._position = body, order, 0

    def table(self, element: Element) -> dict[str, Column]:
        if any(item.count_type for item in element.properties):
            return self._even_lists(element) or self._uneven_lists(element)
        row = np.dtype([(f"{i}", self._order + item.type) for i, item in enumerate(element.properties)])
        rows = self._take(row, element.count)
        return {item.name: rows[f"{i}"] for i, item in enumerate(element.properties)}

    def _take(self, kind: np.dtype, count: int) -> Array:
        if count < 0:
            raise ValueError("a list has a negative length")
        end = self._position + kind.itemsize * count
        if end > len(self._body):
            raise EOFError
        taken = np.frombuffer(self._body, dtype=kind, count=count, offset=self._position)
        self._position = end
        return taken

    def _even_lists(self, element: Element) -> dict[str, Column] | None:
        """All rows at once if every list is as long as that of the first row; None otherwise."""
        if not element.count:
            return {}
        begin = self._position
        lengths = [self._list_length(item.count_type, item.type) for item in element.properties]
        self._position = begin
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for i, (item, length) in enumerate(zip(element.properties, lengths, strict=True)):
            if item.count_type:
                fields += [(f"{i}n", self._order + item.count_type), (f"{i}", self._order + item.type, (length,))]
            else:
                fields.append((f"{i}", self._order + item.type))
        row = np.dtype(fields)
        if begin + row.itemsize * element.count > len(self._body):
            return None
        rows = self._take(row, element.count)
        listed = [(i, length) for i, length in enumerate(lengths) if element.properties[i].count_type]
        if any((rows[f"{i}n"] != length).any() for i, length in listed):
            self._position = begin
            return None
        return {
            item.name: (rows[f"{i}n"], rows[f"{i}"].ravel()) if item.count_type else rows[f"{i}"]
            for i, item in enumerate(element.properties)
        }

    def _list_length(self, count_type: str | None, kind: str) -> int:
        """Length of the list here, which is skipped; 0 for a single number."""
        length = 0 if count_type is None else int(self._take(np.dtype(self._order + count_type), 1)[0])
        self._take(np.dtype(self._order + kind), length if count_type else 1)
        return length

    def _uneven_lists(self, element: Element) -> dict[str, Column]:
        """Row by row: lists of several lengths."""
        kinds = [
            (np.dtype(self._order + item.count_type) if item.count_type else None, np.dtype(self._order + item.type))
            for item in element.properties
        ]
        parts: list[list[Array]] = [[] for _ in kinds]
        for _ in range(element.count):
            for (count_kind, kind), part in zip(kinds, parts, strict=True):
                length = 1 if count_kind is None else int(self._take(count_kind, 1)[0])
                part.append(self._take(kind, length))
        return {
            item.name: _joined(part, bool(item.count_type))
            for item, part in zip(element.properties, parts, strict=True)
        }


def _joined(rows: list[Array], listed: bool) -> Column:
    items = np.concatenate([np.zeros(0), *rows])
    return (np.array([len(row) for row in rows], dtype=np.int64), items) if listed else items


class _Text:
    """Tables of a text file: numbers, whatever the line breaks."""

    def __init__(self, body: bytes) -> None:
        self._numbers, self._position = parse_numbers(body), 0

    def table(self, element: Element) -> dict[str, Column]:
        width = len(element.properties)
        if not any(item.count_type for item in element.properties):
            rows = self._take(width * element.count).reshape(element.count, width)
            return {item.name: rows[:, i] for i, item in enumerate(element.properties)}
        if width == 1:
            return {element.properties[0].name: self._lists(element.count)}
        parts: list[list[Array]] = [[] for _ in element.properties]
        for _ in range(element.count):
            for item, part in zip(element.properties, parts, strict=True):
                part.append(self._take(int(as_indices(self._take(1))[0]) if item.count_type else 1))
        return {
            item.name: _joined(part, bool(item.count_type))
            for item, part in zip(element.properties, parts, strict=True)
        }

    def _lists(self, count: int) -> tuple[Array, Array]:
        """Rows of nothing but one list; at once where all are as long as the first."""
        rest = self._numbers[self._position :]
        length = int(as_indices(rest[:1])[0]) if count and len(rest) else 0
        if length >= 0 and count * (length + 1) <= len(rest):
            rows = rest[: count * (length + 1)].reshape(count, length + 1)
            if (rows[:, 0] == length).all():
                self._position += rows.size
                return rows[:, 0], rows[:, 1:].ravel()
        lists = [self._take(int(as_indices(self._take(1))[0])) for _ in range(count)]
        return np.array([len(row) for row in lists], dtype=np.int64), np.concatenate([np.zeros(0), *lists])

    def _take(self, count: int) -> Array:
        if count < 0:
            raise ValueError("a list has a negative length")
        if self._position + count > len(self._numbers):
            raise EOFError
        self._position += count
        return self._numbers[self._position - count : self._position]
