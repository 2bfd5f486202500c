"""Options of a pydantic config model by dotted key: ``loss.cycle`` for the field `cycle` of the table `loss`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

REQUIRED = PydanticUndefined
"""Default of an option that has none."""


@dataclass(frozen=True)
class Leaf:
    """One option: a field that is not itself a table."""

    key: str
    """Dotted, as in a config file."""
    info: FieldInfo
    default: Any
    """Default in its table, or `REQUIRED`."""


def table_model(info: FieldInfo) -> type[BaseModel] | None:
    """The model of a field that is a table, None for an option. Optional and union tables count as options."""
    annotation = info.annotation
    return annotation if isinstance(annotation, type) and issubclass(annotation, BaseModel) else None


def leaves(model: type[BaseModel]) -> dict[str, Leaf]:
    """All options of `model` by dotted key, in the order of declaration."""
    return {leaf.key: leaf for leaf in _walk(model, "", None)}


def table_keys(model: type[BaseModel]) -> frozenset[str]:
    """Dotted keys of all tables inside `model`."""
    return frozenset(key.rpartition(".")[0] for key in leaves(model) if "." in key) | frozenset(
        name for name, info in model.model_fields.items() if table_model(info)
    )


def nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """The inverse of flattening: tables as dictionaries."""
    root: dict[str, Any] = {}
    for key, value in flat.items():
        *tables, name = key.split(".")
        place = root
        for table in tables:
            place = place.setdefault(table, {})
        place[name] = value
    return root


def as_mapping(value: object) -> Mapping[str, Any] | None:
    """A table given as a mapping or as a model instance (then what was set in it); None for anything else."""
    if isinstance(value, BaseModel):
        return value.model_dump(exclude_unset=True)
    return cast("Mapping[str, Any]", value) if isinstance(value, Mapping) else None


def _walk(model: type[BaseModel], prefix: str, default: object) -> Iterator[Leaf]:
    """`default` is the instance that stands for the whole table where the field above gives one."""
    for name, info in model.model_fields.items():
        own = getattr(default, name) if default is not None else info.get_default(call_default_factory=True)
        table = table_model(info)
        if table is None:
            yield Leaf(prefix + name, info, own)
        else:
            yield from _walk(table, f"{prefix}{name}.", own if isinstance(own, BaseModel) else None)
