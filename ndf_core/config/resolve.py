"""From layers to one validated configuration, with everything that is wrong in one error.

Lowest first: defaults, the plugin's training defaults, the recipe, the config file, the command line.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ValidationError

from ndf_core.api import RepresentationSpec
from ndf_core.config.fields import REQUIRED, leaves, nested
from ndf_core.config.fit import FitConfig
from ndf_core.config.layers import Layer, Merged, merge, shorten
from ndf_core.config.recipes import recipe_layer
from ndf_core.config.toml import ConfigFile, read_config_file
from ndf_core.errors import ConfigError, PluginError

Model = TypeVar("Model", bound=BaseModel)


class DeprecatedOption(FutureWarning):
    """An option was given that a later version will not have. A FutureWarning, since it is meant for users."""


@dataclass(frozen=True)
class Resolved(Generic[Model]):
    """A valid config and where each of its options comes from."""

    config: Model
    origins: Mapping[str, str]
    """By dotted key: "default", "recipe paper: steps", "command line: --steps", "fit.toml: fit.steps"."""


@dataclass(frozen=True)
class ResolvedConfig:
    """Everything a run is configured by."""

    fit: Resolved[FitConfig]
    representation: Resolved[BaseModel] | None
    """None where no representation takes part."""


@dataclass(frozen=True)
class Given:
    """Options as the caller gave them, with the way he wrote them."""

    fit: Mapping[str, Any] = field(default_factory=dict[str, Any])
    representation: Mapping[str, Any] = field(default_factory=dict[str, Any])
    name: str = "arguments"
    spell_fit: Callable[[str], str] = str
    spell_representation: Callable[[str], str] = str


def resolve_config(
    spec: RepresentationSpec | None = None,
    given: Given | None = None,
    *,
    file: ConfigFile | str | Path | None = None,
    training_defaults: Mapping[str, Any] | None = None,
) -> ResolvedConfig:
    """Merge all layers and validate the result once.

    Args:
        spec: the representation whose options and training defaults take part; without it only fit options do.
        given: the top layer.
        file: a config file, or its path.
        training_defaults: those of an opened surface, which stand in for the spec's.

    Raises:
        ConfigError: one line for everything that is wrong, each with its option and its layer.
        PluginError: a validator of the plugin's config failed with something else than an error message.
    """
    given = given or Given()
    file = file if isinstance(file, ConfigFile) or file is None else read_config_file(file)
    errors = list(file.errors) if file else []
    fit = _resolve(FitConfig, fit_layers(spec, given, file, training_defaults), errors)
    representation = _resolve_representation(spec, given, file, errors) if spec else None
    if fit is None or errors:
        raise _wrong(errors)
    return ResolvedConfig(fit, representation)


def resolve_representation(spec: RepresentationSpec, options: Mapping[str, Any]) -> BaseModel:
    """The representation's own options alone, as `ndf_core.open` takes them; raises as `resolve_config` does."""
    errors: list[str] = []
    resolved = _resolve_representation(spec, Given(representation=options), None, errors)
    if resolved is None or errors:
        raise _wrong(errors)
    return resolved.config


def resolve_options(
    model: type[Model], given: Mapping[str, Any], spell: Callable[[str], str] = str, name: str = "command line"
) -> Model:
    """A config of its own, from one layer over its defaults.

    Raises:
        ConfigError: one line for every option that is wrong.
    """
    errors: list[str] = []
    resolved = _resolve(model, [Layer(name, given, spell)], errors)
    if resolved is None or errors:
        raise _wrong(errors)
    return resolved.config


def fit_layers(
    spec: RepresentationSpec | None,
    given: Given,
    file: ConfigFile | None = None,
    training_defaults: Mapping[str, Any] | None = None,
) -> list[Layer]:
    """The layers over the defaults of `FitConfig`, lowest first.

    The recipe's place is low but its name is an option like any other: the highest layer that names one decides.
    """
    below: list[Layer] = []
    if training_defaults or spec:
        name = f"training defaults of {spec.name}" if spec else "training defaults of the surface"
        below.append(Layer(name, training_defaults or (spec.training_defaults if spec else {})))
    above = [*([file.fit_layer()] if file else []), Layer(given.name, given.fit, given.spell_fit)]
    named = [layer.values["recipe"] for layer in (*below, *above) if "recipe" in layer.values]
    recipe = recipe_layer(named[-1] if named else leaves(FitConfig)["recipe"].default)
    return [*below, *([recipe] if recipe else []), *above]


def _wrong(errors: list[str]) -> ConfigError:
    return ConfigError(errors[0] if len(errors) == 1 else "\n  ".join([f"{len(errors)} wrong options:", *errors]))


def _resolve_representation(
    spec: RepresentationSpec, given: Given, file: ConfigFile | None, errors: list[str]
) -> Resolved[BaseModel] | None:
    """Its validators are foreign code: what they raise beside a ValidationError is the plugin's failure."""
    below = [file.representation_layer()] if file else []
    layers = [*below, Layer(given.name, given.representation, given.spell_representation)]
    try:
        return _resolve(spec.config, layers, errors)
    except Exception as error:
        cause = f"{type(error).__name__}: {error}"
        raise PluginError(f"--repr {spec.name}: the plugin failed to check its options: {cause}") from error


def _resolve(model: type[Model], layers: Iterable[Layer], errors: list[str]) -> Resolved[Model] | None:
    """The validated model; None after adding to `errors`."""
    defaults = {key: leaf.default for key, leaf in leaves(model).items() if leaf.default is not REQUIRED}
    merged = merge(model, layers)
    errors.extend(merged.errors)
    for key, origin in merged.origins.items():
        instead = leaves(model)[key].info.deprecated
        if instead:
            text = f": {instead}" if isinstance(instead, str) else ""
            warnings.warn(f"{origin}: this option is deprecated{text}", DeprecatedOption, stacklevel=3)
    try:
        config = model.model_validate(nested({**defaults, **merged.values}))
    except ValidationError as error:
        errors.extend(_explain(error, model, merged))
        return None
    return Resolved(config, {key: merged.origins.get(key, "default") for key in leaves(model)})


def _explain(error: ValidationError, model: type[BaseModel], merged: Merged) -> Iterable[str]:
    """One line per pydantic error: origin, what is wrong, the value."""
    known = leaves(model)
    for item in error.errors(include_url=False, include_context=False):
        path = [str(part) for part in item["loc"]]
        key = next((k for n in range(len(path), 0, -1) if (k := ".".join(path[:n])) in known), ".".join(path))
        message = item["msg"].removeprefix("Value error, ")
        message = message[:1].lower() + message[1:]
        if item["type"] == "missing" and key not in merged.values:
            yield f"{key}: is required; give --{key.replace('_', '-')} or `{key}` in the config file"
        elif key in merged.values:
            yield f"{merged.origins[key]}: {message} (got {shorten(merged.values[key])})"
        else:
            inside = [merged.origins[k] for k in merged.values if not key or k.startswith(f"{key}.")]
            yield f"{', '.join(inside) or key or 'options'}: {message}"
