"""From pydantic models to click options: ``loss.cycle`` becomes ``--loss.cycle``, ``feature_dim`` ``--feature-dim``.

click only collects the text; pydantic converts and checks it, together with every other layer.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import click
from pydantic import BaseModel

from ndf_core.config.fields import REQUIRED, Leaf, leaves

_SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "multiple_of": "multiple of"}


@dataclass(frozen=True)
class OptionGroup:
    """The options of one model."""

    title: str
    options: tuple[click.Option, ...]
    leaves: Mapping[str, Leaf]
    """By click's parameter name."""
    spelled: Mapping[str, str]
    """By dotted key: ``--loss.cycle``."""

    def given(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """What the user gave, by dotted key."""
        found = [(leaf, parameters.get(name)) for name, leaf in self.leaves.items()]
        return {leaf.key: _value(text, leaf.info.annotation) for leaf, text in found if text is not None}

    def spell(self, key: str) -> str:
        return self.spelled.get(key, key)


def option_group(
    model: type[BaseModel], title: str, taken: frozenset[str], prefix: str, defaults: Mapping[str, Any]
) -> OptionGroup:
    """Options for all of `model`.

    Args:
        taken: spellings that exist already; an option that would collide is called ``--<prefix>.<key>``.
        prefix: also keeps click's parameter names apart.
        defaults: by dotted key, for the help; over the model's own.
    """
    options: list[click.Option] = []
    named: dict[str, Leaf] = {}
    spelled: dict[str, str] = {}
    for key, leaf in leaves(model).items():
        word = key.replace("_", "-")
        word = f"{prefix}.{word}" if f"--{word}" in taken else word
        name = f"{prefix}_{key}".replace(".", "__").replace("-", "_")
        named[name], spelled[key] = leaf, f"--{word}"
        options.append(_option(leaf, word, name, defaults.get(key, leaf.default)))
    return OptionGroup(title, tuple(options), named, spelled)


def _option(leaf: Leaf, word: str, name: str, default: Any) -> click.Option:
    facts = [] if default is REQUIRED else [f"default: {_shown(default)}"]
    if bounds := _bounds(leaf):
        facts.append(bounds)
    if default is REQUIRED:
        facts.append("required")
    if leaf.info.deprecated:
        facts.append("deprecated" + (f": {leaf.info.deprecated}" if isinstance(leaf.info.deprecated, str) else ""))
    text = f"{leaf.info.description or ''}  [{'; '.join(facts)}]".strip()
    if leaf.info.annotation is bool:
        return click.Option([f"--{word}/--no-{word}", name], default=None, help=text)
    return click.Option([f"--{word}", name], default=None, metavar=_metavar(leaf.info.annotation), help=text)


def _bounds(leaf: Leaf) -> str:
    """The constraints of a field as pydantic keeps them, e.g. ">= 4, <= 2000000"."""
    found = [
        f"{sign} {_shown(bound)}"
        for item in leaf.info.metadata
        for attribute, sign in _SIGNS.items()
        if (bound := getattr(item, attribute, None)) is not None
    ]
    return ", ".join(found)


def _shown(value: Any) -> str:
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, float):
        return f"{value:g}"
    return "none" if value is None else str(value)


def _alternatives(annotation: Any) -> list[Any]:
    """Members of a union, or the annotation itself."""
    return list(get_args(annotation)) if get_origin(annotation) in (Union, UnionType) else [annotation]


def _metavar(annotation: Any) -> str:
    names: list[str] = []
    for member in _alternatives(annotation):
        if get_origin(member) is Literal:
            names.extend(str(value) for value in get_args(member))
        elif isinstance(member, type) and issubclass(member, Enum):
            names.extend(str(value.value) for value in member)
        elif member is not NoneType:
            names.append({int: "INTEGER", float: "NUMBER", str: "TEXT", Path: "PATH"}.get(member, "VALUE"))
    return f"[{'|'.join(names)}]" if len(names) > 1 else "".join(names)


def _value(text: Any, annotation: Any) -> Any:
    """Text, which pydantic converts; or the TOML value that it spells, where pydantic takes no text (an array)."""
    members = _alternatives(annotation)
    if not isinstance(text, str):
        return text
    if NoneType in members and text == "none":
        return None
    if all(member in (int, float, str, bool, Path, NoneType) or _takes_text(member) for member in members):
        return text
    for attempt in (text, f"[{text}]"):
        try:
            return tomllib.loads(f"value = {attempt}")["value"]
        except tomllib.TOMLDecodeError:
            continue
    return text


def _takes_text(member: Any) -> bool:
    choices: tuple[Any, ...] = get_args(member) if get_origin(member) is Literal else ()
    if isinstance(member, type) and issubclass(member, Enum):
        choices = tuple(value.value for value in member)
    return bool(choices) and all(isinstance(choice, str) for choice in choices)
