"""Import one plugin's entry module, ask for its `RepresentationSpec`, and check that it keeps the contract."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from importlib.metadata import EntryPoint
from typing import Any

import pluggy
from pydantic import BaseModel

from ndf_core import api
from ndf_core.config.fields import nested, table_model
from ndf_core.config.fit import FitConfig
from ndf_core.config.layers import Layer, merge, nearest
from ndf_core.errors import PluginError, RepresentationError
from ndf_core.plugins.discovery import Entry, entries
from ndf_core.plugins.guard import SECONDS, ForeignFailure, guarded, one_line

_TARGET = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")


def load(name: str) -> api.RepresentationSpec:
    """The spec of the representation called `name`.

    Raises:
        RepresentationError: no plugin claims the name.
        PluginError: its plugin cannot be used.
    """
    claims = [entry for entry in entries() if entry.name == name]
    if not claims:
        names = dict.fromkeys(entry.name for entry in entries())
        raise RepresentationError(f"--repr {name}: there is no such representation; {nearest(name, names)}")
    usable = [entry for entry in claims if entry.error is None]
    return load_entry((usable or claims)[0])


def load_entry(entry: Entry, seconds: float = SECONDS) -> api.RepresentationSpec:
    """The checked spec of one claim.

    Raises:
        PluginError: it cannot be used; the message says which distribution and why, in one line.
    """
    cause = entry.error
    if cause is None:
        try:
            spec, cause = guarded(lambda: _examine(entry), f"importing {entry.target}", seconds)
            if cause is None:
                return spec
        except ForeignFailure as failure:
            cause = str(failure)
    raise PluginError(f"--repr {entry.name}: the plugin {entry.origin} cannot be used: {cause}")


@lru_cache(maxsize=1)
def load_usable() -> tuple[list[api.RepresentationSpec], list[str]]:
    """All specs that can be had, and one line for each that cannot; tried once per process."""
    specs: list[api.RepresentationSpec] = []
    broken: list[str] = []
    for entry in entries():
        try:
            specs.append(load_entry(entry))
        except PluginError as error:
            broken.append(str(error))
    return specs, broken


def _examine(entry: Entry) -> tuple[api.RepresentationSpec, str | None]:
    spec = _ask(entry)
    return spec, next(_faults(spec, entry.name), None)


def _ask(entry: Entry) -> api.RepresentationSpec:
    """One pluggy manager per plugin, so that none can see or shadow another's hook."""
    manager = pluggy.PluginManager(api.PROJECT)
    manager.add_hookspecs(api)
    manager.register(EntryPoint(entry.name, entry.target, api.ENTRY_POINT_GROUP).load())
    manager.check_pending()
    if not manager.hook.ndf_representation.get_hookimpls():
        raise TypeError("it has no @hookimpl function ndf_representation")
    return manager.hook.ndf_representation()


def _faults(spec: Any, name: str) -> Iterator[str]:
    """What breaks the contract, the gravest first. Foreign: the types that the spec declares are not believed."""
    if not isinstance(spec, api.RepresentationSpec):
        yield f"ndf_representation() returned {type(spec).__name__}, not a RepresentationSpec"
        return
    yield from _version_faults(spec.api_version)
    if spec.name != name:
        yield f"the entry point is called {name!r} but the representation {spec.name!r}"
    if spec.support not in ("full", "partial"):
        yield f"support must be 'full' or 'partial', not {spec.support!r}"
    if not _TARGET.fullmatch(str(spec.open)):
        yield f"open must look like 'package.module:function', not {spec.open!r}"
    yield from _config_faults(spec.config)
    yield from _training_faults(spec.training_defaults)


def _version_faults(version: object) -> Iterator[str]:
    if version != api.API_VERSION:
        newer = isinstance(version, int) and version > api.API_VERSION
        advice = "upgrade ndf-core" if newer else "upgrade the plugin"
        yield f"it speaks plugin API version {version!r}, this ndf-core {api.API_VERSION}; {advice}"


def _config_faults(model: object) -> Iterator[str]:
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        yield f"config must be a pydantic model class, not {model!r}"
        return
    tables = [table for info in model.model_fields.values() if (table := table_model(info))]
    if not model.model_config.get("frozen"):
        yield f"config model {model.__name__} must be frozen"
    if model.model_config.get("extra") != "forbid":
        yield f"config model {model.__name__} must forbid extra options"
    for field, info in model.model_fields.items():
        if not (info.description or table_model(info)):
            yield f"option {field} of config model {model.__name__} has no description"
        if info.alias or info.validation_alias:
            yield f"option {field} of config model {model.__name__} has an alias"
    for table in tables:
        yield from _config_faults(table)


def _training_faults(defaults: object) -> Iterator[str]:
    if not isinstance(defaults, Mapping):
        yield f"training_defaults must be a mapping, not {type(defaults).__name__}"
        return
    merged = merge(FitConfig, [Layer("training_defaults", defaults)])
    yield from merged.errors
    try:
        FitConfig.model_validate(nested(merged.values))
    except ValueError as error:
        yield f"training_defaults: {one_line(error)}"
