"""What a command answers: data for programs, text for people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ndf_core.plain_json import plain


@dataclass(frozen=True)
class Result:
    """Returned by every command and printed by `guard`, either as one JSON object or as text."""

    data: Any
    text: str = ""
    exit_code: int = 0


class Interrupted(Exception):
    """The user stopped the command; the message says how to go on."""


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


def _human(value: Any) -> str:
    value = plain(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(_human(item) for item in value) or "none"
    return "none" if value is None else str(value)
