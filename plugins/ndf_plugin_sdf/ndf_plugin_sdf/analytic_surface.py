"""Opening `analytic`: a CSG tree or a function becomes a field, and the field a surface."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_core.surfaces.level_set_surface import level_set_surface
from ndf_plugin_sdf.analytic import AnalyticConfig, names_callable
from ndf_plugin_sdf.callable_field import CallableField
from ndf_plugin_sdf.containment import check_contained
from ndf_plugin_sdf.csg.tree import parse_tree, read_tree
from ndf_plugin_sdf.defaults import COSTLY_TRAINING_DEFAULTS
from ndf_plugin_sdf.tree_field import TreeField
from ndf_plugin_sdf.user_function import find, probe


def open_analytic(source: str | Path | object, config: AnalyticConfig) -> Surface:
    """Open a CSG tree (file, or the same as nested mappings), or a function (named, or the function itself).

    A function runs with the rights of the caller: it is code.

    Raises:
        InputError: the source is none of these, or not a closed solid within its bounds.
    """
    if isinstance(source, dict):
        return _from_tree(parse_tree(source), config)
    if callable(source):
        return _from_function(getattr(source, "__qualname__", type(source).__name__), source, b"", config)
    if not isinstance(source, str | Path):
        raise InputError(f"analytic: need a file, module:callable, a function or a tree, not {type(source).__name__}")
    if names_callable(source):
        function, module = find(str(source))
        return _from_function(str(source), function, _text_of(module), config)
    path = Path(source)
    if path.is_dir():
        raise InputError(f"{path}: is a directory, not a CSG tree in TOML or JSON")
    return _from_tree(read_tree(path), config)


def _from_tree(tree: Any, config: AnalyticConfig) -> Surface:
    field = TreeField(tree, _box(config.bounds))
    if config.lipschitz is not None:
        field.lipschitz = config.lipschitz
    if config.bounds is not None:
        check_contained(field, "the solid")
    return _surface(field, config, [tree.model_dump_json()], ())


def _from_function(name: str, function: Callable[[Any], Any], text: bytes, config: AnalyticConfig) -> Surface:
    bounds = _box(config.bounds) or _own_bounds(name, function)
    rng = np.random.default_rng(0)
    points = torch.from_numpy(bounds.lower + rng.random((4096, 3)) * (bounds.upper - bounds.lower))
    wrapped = probe(name, function, points[:7])
    field = CallableField(wrapped, bounds, config.lipschitz)
    check_contained(field, name)
    notes = [] if config.lipschitz else [f"|{name}| estimated to be at most {field.lipschitz:.3g} times the distance"]
    if not wrapped.differentiable:
        notes.append(f"{name} is not differentiable by torch; its gradient is taken numerically")
    # What the function computes counts, besides its text: it may use other modules.
    return _surface(field, config, [text, field.values(points).numpy()], tuple(notes))


def _surface(field: ImplicitField, config: AnalyticConfig, content: list[Any], notes: tuple[str, ...]) -> Surface:
    return level_set_surface(
        "analytic",
        field,
        resolution=config.resolution,
        corrections=config.corrections,
        fingerprint=fingerprint("analytic", config, content),
        training_defaults=COSTLY_TRAINING_DEFAULTS,
        notes=notes,
    )


def _box(bounds: Any) -> Box | None:
    return None if bounds is None else Box(np.array(bounds[0], np.float64), np.array(bounds[1], np.float64))


def _own_bounds(name: str, function: Callable[[Any], Any]) -> Box:
    """The function's attribute `bounds`.

    Raises:
        InputError: it has none, or it is no box.
    """
    own: Any = getattr(function, "bounds", None)
    if own is None:
        raise InputError(f"{name}: give the box that holds its surface, --bounds '[[-1, -1, -1], [1, 1, 1]]'")
    try:
        bounds = np.array(own, dtype=np.float64)
    except (TypeError, ValueError):
        bounds = np.zeros(0)
    if bounds.shape != (2, 3) or not np.isfinite(bounds).all() or not (bounds[0] < bounds[1]).all():
        raise InputError(f"{name}: its attribute `bounds` is not a box [[x, y, z], [x, y, z]], low corner first")
    return Box(bounds[0], bounds[1])


def _text_of(module: Any) -> bytes:
    try:
        return inspect.getsource(module).encode()
    except (OSError, TypeError):  # built-in or compiled: its values alone speak for it
        return b""
