"""What a command answers: data for programs, text for people."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Result:
    """Returned by every command and printed by `guard`, either as one JSON object or as text."""

    data: Any
    text: str = ""
    exit_code: int = 0


class Interrupted(Exception):
    """The user stopped the command; the message says how to go on."""


def as_json(data: Any) -> str:
    """One line of JSON; numbers that JSON lacks (nan, infinity) become null."""
    return json.dumps(_plain(data), allow_nan=False)


def as_lines(data: Mapping[str, Any], indent: str = "") -> str:
    """Nested mappings as indented "key: value" lines."""
    lines: list[str] = []
    for key, value in data.items():
        name = f"{indent}{key.replace('_', ' ')}:"
        if isinstance(value, Mapping) and value:
            lines += [name, as_lines(value, f"{indent}  ")]
        else:
            lines.append(f"{name} {_human(value)}")
    return "\n".join(lines)


def _plain(value: Any) -> Any:
    """JSON's own types; numpy scalars and arrays give theirs through `tolist`."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return _plain(value.tolist()) if hasattr(value, "tolist") else str(value)


def _human(value: Any) -> str:
    value = _plain(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(_human(item) for item in value) or "none"
    return "none" if value is None else str(value)
