"""Layers of options, each of which knows how its user would spell a key, merged with the origin of every value."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from ndf_core.config.fields import as_mapping, leaves, table_keys
from ndf_core.names import nearest


@dataclass(frozen=True)
class Layer:
    """Options that come from one place."""

    name: str
    """Where they come from, for messages: "command line", "fit.toml", "recipe paper"."""
    values: Mapping[str, Any]
    """Nested tables, or dotted keys."""
    spell: Callable[[str], str] = str
    """The dotted key as it is written there: ``--loss.cycle``, ``fit.loss.cycle``."""

    def origin(self, key: str) -> str:
        """Place and spelling of one option."""
        return f"{self.name}: {self.spell(key)}"


@dataclass(frozen=True)
class Merged:
    """What the layers say together; later layers win."""

    values: Mapping[str, Any]
    """By dotted key."""
    origins: Mapping[str, str]
    """By dotted key, of the same keys."""
    errors: tuple[str, ...]
    """Keys that no option has, and values in the place of tables."""


def merge(model: type[BaseModel], layers: Iterable[Layer]) -> Merged:
    """Merge `layers`, lowest first, over the options of `model`."""
    known, tables = leaves(model), table_keys(model)
    values: dict[str, Any] = {}
    origins: dict[str, str] = {}
    errors: list[str] = []
    for layer in layers:
        for key, value in _flatten(layer.values, "", tables):
            if key in known:
                values[key], origins[key] = value, layer.origin(key)
            elif key in tables:
                errors.append(f"{layer.origin(key)}: must be a table of options (got {shorten(value)})")
            else:
                errors.append(f"{layer.origin(key)}: there is no such option; {nearest(key, known)}")
    return Merged(values, origins, tuple(errors))


def shorten(value: object, width: int = 60) -> str:
    """A value as a message quotes it."""
    text = repr(value)
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _flatten(values: Mapping[str, Any], prefix: str, tables: frozenset[str]) -> Iterable[tuple[str, Any]]:
    """Only tables of the model are entered: a mapping elsewhere is a value, right or wrong."""
    for name, value in values.items():
        key = f"{prefix}{name}"
        inner = as_mapping(value) if key in tables else None
        if inner is None:
            yield key, value
        else:
            yield from _flatten(inner, f"{key}.", tables)
