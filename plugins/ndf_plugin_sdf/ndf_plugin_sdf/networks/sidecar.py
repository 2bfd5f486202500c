"""The description beside a file of weights: TOML or JSON with the options of `neural`."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ndf_core.errors import InputError
from ndf_plugin_sdf.neural import NeuralConfig

_MOST_BYTES = 1 << 20
_OWN = ("network", "bounds", "iso", "inside")
"""What a description may say; how to sample and to correct is for the user."""


def with_description(weights: Path, config: NeuralConfig) -> tuple[NeuralConfig, list[str]]:
    """The options completed by the file that describes the weights, if there is one, and notes about that.

    An option that the user gave counts more.

    Raises:
        InputError: the file cannot be read, or says something that is no option.
    """
    path = _file(weights, config)
    if path is None:
        return config, []
    said = _content(path)
    unknown = [key for key in said if key not in _OWN]
    if unknown:
        raise InputError(f"{path}: {unknown[0]!r} is not one of {', '.join(_OWN)}; it describes {weights.name}")
    given = {name: getattr(config, name) for name in config.model_fields_set}
    network = said.get("network", {})
    if "network" in given and isinstance(network, dict):
        own = config.network
        network = {**network, **{name: getattr(own, name) for name in own.model_fields_set}}
    try:
        merged = NeuralConfig.model_validate({**said, **given, "network": network})
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors()[:8])
        raise InputError(f"{path}: {faults}") from error
    return merged, [f"described by {path.name}"]


def _file(weights: Path, config: NeuralConfig) -> Path | None:
    if config.description is not None:
        return Path(config.description)
    beside = [weights.with_suffix(suffix) for suffix in (".toml", ".json")]
    return next((path for path in beside if path.is_file() and path != weights), None)


def _content(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
        if len(text) > _MOST_BYTES:
            raise InputError(f"{path}: more than {_MOST_BYTES} bytes are no description")
        said: Any = json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text.decode())
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: {error}") from error
    if not isinstance(said, dict):
        raise InputError(f"{path}: need a table with any of {', '.join(_OWN)}")
    return said
