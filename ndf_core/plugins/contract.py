"""What a `RepresentationSpec` has to be, one rule per function: the loader refuses a plugin that breaks one, and
`ndf_core.testing` reports each under its name. A rule says what is wrong, or None; the first line of its docstring is
its reason. Plugins are foreign: the types that a spec declares are not believed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, cast

from pydantic import BaseModel

from ndf_core import api
from ndf_core.config.fields import nested, table_model
from ndf_core.config.fit import FitConfig
from ndf_core.config.layers import Layer, merge
from ndf_core.lines import one_line

Rule = Callable[[api.RepresentationSpec, str], str | None]
"""Of a spec and the name of its entry point."""

_TARGET = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")


def api_version_is_spoken(spec: api.RepresentationSpec, name: str) -> str | None:
    """A plugin made for another contract would fail later, in ways that nobody understands."""
    del name
    return version_fault(spec.api_version)


def version_fault(version: object) -> str | None:
    """The same for a spec of any kind."""
    if type(version) is int and version == api.API_VERSION:  # True is 1 as well
        return None
    newer = isinstance(version, int) and version > api.API_VERSION
    advice = "upgrade ndf-core" if newer else "upgrade the plugin"
    return f"it speaks plugin API version {version!r}, this ndf-core {api.API_VERSION}; {advice}"


def name_is_that_of_the_entry_point(spec: api.RepresentationSpec, name: str) -> str | None:
    """Listings read the entry point's name, and runs the spec's."""
    if spec.name == name:
        return None
    return f"the entry point is called {name!r} but the representation {spec.name!r}"


def support_is_full_or_partial(spec: api.RepresentationSpec, name: str) -> str | None:
    """Users are told whether the paper's limits apply."""
    del name
    known = spec.support in ("full", "partial")
    return None if known else f"support must be 'full' or 'partial', not {spec.support!r}"


def open_names_a_function(spec: api.RepresentationSpec, name: str) -> str | None:
    """What opens files is imported when a run starts, by this name."""
    del name
    return target_fault(spec.open, "open")


def target_fault(target: object, what: str) -> str | None:
    """Whether this is "package.module:function"."""
    if _TARGET.fullmatch(str(target)):
        return None
    return f"{what} must look like 'package.module:function', not {target!r}"


def config_is_a_pydantic_model(spec: api.RepresentationSpec, name: str) -> str | None:
    """Options, their help and their checks are made from the model."""
    del name
    return None if _models(spec) else f"config must be a pydantic model class, not {spec.config!r}"


def config_is_frozen(spec: api.RepresentationSpec, name: str) -> str | None:
    """The config is part of the fingerprint, so nothing may change it after validation."""
    del name
    loose = [model for model in _models(spec) if not model.model_config.get("frozen")]
    return f"config model {loose[0].__name__} must be frozen" if loose else None


def config_forbids_extra_options(spec: api.RepresentationSpec, name: str) -> str | None:
    """A misspelt option must be an error, never be ignored."""
    del name
    loose = [model for model in _models(spec) if model.model_config.get("extra") != "forbid"]
    return f"config model {loose[0].__name__} must forbid extra options" if loose else None


def config_describes_every_option(spec: api.RepresentationSpec, name: str) -> str | None:
    """The description is the option's help."""
    del name
    for model in _models(spec):
        for field, info in model.model_fields.items():
            if not (info.description or table_model(info)):
                return f"option {field} of config model {model.__name__} has no description"
    return None


def config_has_no_aliases(spec: api.RepresentationSpec, name: str) -> str | None:
    """An option has one name, on the command line, in files and in Python."""
    del name
    for model in _models(spec):
        for field, info in model.model_fields.items():
            if info.alias or info.validation_alias:
                return f"option {field} of config model {model.__name__} has an alias"
    return None


def training_defaults_are_fit_options(spec: api.RepresentationSpec, name: str) -> str | None:
    """They are a layer of the fit's configuration and are validated as such."""
    del name
    if not isinstance(cast("object", spec.training_defaults), Mapping):
        return f"training_defaults must be a mapping, not {type(spec.training_defaults).__name__}"
    merged = merge(FitConfig, [Layer("training_defaults", spec.training_defaults)])
    if merged.errors:
        return merged.errors[0]
    try:
        FitConfig.model_validate(nested(merged.values))
    except ValueError as error:
        return f"training_defaults: {one_line(error)}"
    return None


RULES: tuple[Rule, ...] = (
    api_version_is_spoken,
    name_is_that_of_the_entry_point,
    support_is_full_or_partial,
    open_names_a_function,
    config_is_a_pydantic_model,
    config_is_frozen,
    config_forbids_extra_options,
    config_describes_every_option,
    config_has_no_aliases,
    training_defaults_are_fit_options,
)
"""The gravest first."""


def _models(spec: api.RepresentationSpec) -> list[type[BaseModel]]:
    """The config model and those of its tables; none where it is no model."""
    model: Any = spec.config
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        return []
    return list(_with_tables(model))


def _with_tables(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    yield model
    for info in model.model_fields.values():
        table = table_model(info)
        if table is not None:
            yield from _with_tables(table)
