"""Reading a CSG tree: TOML or JSON text to nodes, with every fault named by its place in the tree."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import Field, TypeAdapter, ValidationError

from ndf_core.errors import InputError
from ndf_plugin_sdf.csg.axial import CappedCylinder, Capsule, Cone, Torus
from ndf_plugin_sdf.csg.combine import (
    Difference,
    Intersection,
    SmoothDifference,
    SmoothIntersection,
    SmoothUnion,
    Union,
)
from ndf_plugin_sdf.csg.ellipsoid import Ellipsoid
from ndf_plugin_sdf.csg.faults import describe
from ndf_plugin_sdf.csg.node import Modifier, Node
from ndf_plugin_sdf.csg.placement import Mirror, Rotate, Scale, Translate
from ndf_plugin_sdf.csg.repetition import Repeat, RepeatAround
from ndf_plugin_sdf.csg.shaping import Ripple, Round, Shell, Twist
from ndf_plugin_sdf.csg.solids import Cuboid, Plane, RoundedBox, Sphere

MOST_BYTES = 4 << 20
MOST_NODES = 2000
DEEPEST = 40
MOST_COST = 20_000
"""Most primitives evaluated per point, copies counted."""

_AnyNode = (
    Sphere | Cuboid | RoundedBox | Plane | Torus | Capsule | CappedCylinder | Cone | Ellipsoid
    | Union | Intersection | Difference | SmoothUnion | SmoothIntersection | SmoothDifference
    | Translate | Rotate | Scale | Mirror | Round | Shell | Ripple | Twist | Repeat | RepeatAround
)  # fmt: skip

Shape = Annotated[_AnyNode, Field(discriminator="type")]
"""Any node; its `type` says which."""

for _class in (Modifier, *get_args(_AnyNode)):
    _class.model_rebuild(_types_namespace={"Shape": Shape})

_reader: TypeAdapter[Node] = TypeAdapter(Shape)


def read_tree(path: Path) -> Node:
    """Read the CSG tree in a TOML or JSON file.

    Raises:
        InputError: the file cannot be read, is no TOML or JSON, or is no valid tree; all faults of a tree at once.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: more than {MOST_BYTES >> 20} MiB; a CSG tree is a small text file")
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not text in UTF-8, so neither TOML nor JSON") from error
    is_json = path.suffix.lower() == ".json"
    try:
        document: Any = json.loads(text) if is_json else tomllib.loads(text)
    except RecursionError as error:
        raise InputError(f"{path}: {_TOO_DEEP}") from error
    except ValueError as error:
        raise InputError(f"{path}: not valid {'JSON' if is_json else 'TOML'}: {error}") from error
    return parse_tree(document, str(path))


def parse_tree(document: object, origin: str = "the tree") -> Node:
    """Validate a tree of plain dictionaries, lists and numbers.

    Raises:
        InputError: it is no valid tree, or too large; all faults at once, each with its place.
    """
    if not isinstance(document, dict) or "type" not in document:
        raise InputError(f'{origin}: not a CSG tree: it has no `type` at the top, such as type = "sphere"')
    _check_size(document, origin)
    try:
        tree = _reader.validate_python(document)
    except ValidationError as error:
        raise InputError("\n".join([f"{origin}: not a valid CSG tree", *describe(error, document)])) from error
    if tree.cost > MOST_COST:
        raise InputError(
            f"{origin}: each point needs {tree.cost:,} primitives, copies counted, more than {MOST_COST:,}; "
            "space the copies of `repeat` wider, or nest fewer of them"
        )
    return tree


_TOO_DEEP = f"nested too deeply; at most {DEEPEST} levels of solids are allowed"


def _check_size(document: dict[str, Any], origin: str) -> None:
    """Bound depth and node count before anything recursive sees the tree."""
    waiting: list[tuple[object, int]] = [(document, 1)]
    nodes = 0
    while waiting:
        item, depth = waiting.pop()
        if isinstance(item, dict):
            nodes += 1
            waiting.extend((value, depth + 1) for value in item.values())
        elif isinstance(item, list):
            # A list of solids is no level of its own.
            waiting.extend((value, depth) for value in item if isinstance(value, dict | list))
        if depth > DEEPEST + 1:
            raise InputError(f"{origin}: {_TOO_DEEP}")
        if nodes > MOST_NODES:
            raise InputError(f"{origin}: more than {MOST_NODES} solids; `repeat` makes copies cheaply")
