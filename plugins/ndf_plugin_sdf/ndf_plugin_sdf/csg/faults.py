"""What pydantic found wrong with a CSG tree, in words and with the place in the tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

MOST_FAULTS = 20


def describe(error: ValidationError, document: object) -> list[str]:
    """One line per fault, such as ``shape.children[1].radius: must be at least 1e-12 (got -1)``."""
    faults = error.errors(include_url=False)
    # A list whose items have faults is reported as too short besides, because it is left without them.
    places = [fault["loc"] for fault in faults]
    faults = [
        fault
        for fault in faults
        if fault["type"] != "too_short" or not any(_inside(place, fault["loc"]) for place in places)
    ]
    lines = [f"  {_place(document, fault['loc'])}: {_complaint(fault)}" for fault in faults[:MOST_FAULTS]]
    if len(faults) > MOST_FAULTS:
        lines.append(f"  ... and {len(faults) - MOST_FAULTS} more")
    return list(dict.fromkeys(lines))


def _inside(place: Sequence[str | int], outer: Sequence[str | int]) -> bool:
    return len(place) > len(outer) and place[: len(outer)] == outer


def _place(document: object, location: Sequence[str | int]) -> str:
    """``shape.children[1].radius`` for pydantic's location, which also names the type taken at every node."""
    place, item = "shape", document
    for step in location:
        if isinstance(step, int):
            place += f"[{step}]"
            item = item[step] if isinstance(item, list | tuple) and step < len(item) else None
        elif isinstance(item, Mapping) and item.get("type") != step:
            place += f".{step}"
            item = item.get(step)
    return place


_WORDS = {
    "missing": "is missing",
    "extra_forbidden": "is not a field of this solid",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "tuple_type": "must be a list",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than_equal": "must be at most {le:g}",
    "too_short": "must have {min_length} or more entries",
    "too_long": "must have at most {max_length} entries",
    "literal_error": "must be {expected}",
    "union_tag_invalid": "there is no solid of type {tag!r}; there are {expected_tags}",
    "union_tag_not_found": 'a solid needs a `type`, such as "sphere"',
    "model_attributes_type": "must be a solid: a table with a `type`",
    "value_error": "{error}",
}


def _complaint(fault: Any) -> str:
    words = _WORDS.get(fault["type"])
    message = words.format(**fault.get("ctx", {})) if words else str(fault["msg"])
    given = fault["input"]
    shown = isinstance(given, int | float | str) and fault["type"] not in ("missing", "union_tag_invalid")
    return message + (f" (got {given!r:.60})" if shown else "")
