"""Checked access to parsed JSON: every read states a type and bounds, every error names the place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ndf_core.errors import AssetError


class Values:
    """A JSON value and where it stands. Every method raises AssetError where the value is not what was asked for."""

    def __init__(self, value: Any, place: str) -> None:
        self.value = value
        self.place = place
        self._read = set[str]()

    def names(self) -> list[str]:
        return list(self._mapping())

    def close(self) -> None:
        """Refuse keys that nothing has read: a reader that skips what it does not know misreads the file."""
        unknown = sorted(set(self._mapping()) - self._read)
        if unknown:
            raise AssetError(f"its {self.place} has an unknown entry {unknown[0][:80]!r}")

    def at(self, key: str) -> Values:
        mapping = self._mapping()
        if key not in mapping:
            raise AssetError(f"its {self.place} lacks {key!r}")
        self._read.add(key)
        return Values(mapping[key], f"{self.place}.{key}")

    def object(self, key: str) -> Values:
        inner = self.at(key)
        inner._mapping()
        return inner

    def mapping(self, key: str) -> Mapping[str, Any]:
        return self.at(key)._mapping()

    def entries(self, least: int, most: int) -> list[Values]:
        """The entries of this value, a list of bounded length."""
        if not isinstance(self.value, list) or not least <= len(self.value) <= most:
            raise AssetError(f"its {self.place} is not a list of {least} to {most} entries")
        return [Values(item, f"{self.place}[{i}]") for i, item in enumerate(self.value)]

    def integer(self, key: str, low: int, high: int) -> int:
        return self.at(key).as_integer(low, high)

    def number(self, key: str, low: float, high: float) -> float:
        return self.at(key).as_number(low, high)

    def choice(self, key: str, known: Sequence[str]) -> str:
        return self.at(key).as_choice(known)

    def boolean(self, key: str) -> bool:
        inner = self.at(key)
        if not isinstance(inner.value, bool):
            raise AssetError(f"its {inner.place} is not true or false")
        return inner.value

    def as_integer(self, low: int, high: int) -> int:
        if not isinstance(self.value, int) or isinstance(self.value, bool) or not low <= self.value <= high:
            raise AssetError(f"its {self.place} is not an integer from {low} to {high}")
        return self.value

    def as_number(self, low: float, high: float) -> float:
        """A finite number whose magnitude a float64 holds; integers count as numbers."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
            raise AssetError(f"its {self.place} is not a number from {low:g} to {high:g}")
        return float(value)

    def as_text(self, longest: int) -> str:
        """Printable text of 1 to `longest` characters."""
        value = self.value
        if not (isinstance(value, str) and 1 <= len(value) <= longest and value.isprintable()):
            raise AssetError(f"its {self.place} is not printable text of 1 to {longest} characters")
        return value

    def as_choice(self, known: Sequence[str]) -> str:
        if not isinstance(self.value, str):
            raise AssetError(f"its {self.place} is not a word")
        if self.value not in known:
            raise AssetError(f"its {self.place} is {self.value[:80]!r}; this program knows {', '.join(known)}")
        return self.value

    def _mapping(self) -> Mapping[str, Any]:
        if not isinstance(self.value, dict):
            raise AssetError(f"its {self.place} is not an object")
        return self.value
