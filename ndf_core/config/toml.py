"""Config files: TOML with the tables ``[fit]`` and ``[representation]`` and the key ``repr``."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ndf_core.config.layers import Layer, shorten
from ndf_core.errors import ConfigError
from ndf_core.names import nearest

MAX_BYTES = 1 << 20
"""No config file is this long; a large file was named by mistake."""


@dataclass(frozen=True)
class ConfigFile:
    """A parsed config file; nothing in its tables is validated yet."""

    name: str
    """As the user gave it."""
    repr: str | None = None
    fit: Mapping[str, Any] = field(default_factory=dict[str, Any])
    representation: Mapping[str, Any] = field(default_factory=dict[str, Any])
    errors: tuple[str, ...] = ()
    """What is wrong with its top-level keys, for the one error that lists everything."""

    def fit_layer(self) -> Layer:
        return Layer(self.name, self.fit, lambda key: f"fit.{key}")

    def representation_layer(self) -> Layer:
        return Layer(self.name, self.representation, lambda key: f"representation.{key}")


def read_toml(path: str | Path) -> dict[str, Any]:
    """Parse a TOML file.

    Raises:
        ConfigError: it cannot be read, is longer than `MAX_BYTES`, or has a syntax error (with its line).
    """
    try:
        with Path(path).open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read as a config file: {error.strerror or error}") from error
    if len(raw) > MAX_BYTES:
        raise ConfigError(f"{path}: longer than {MAX_BYTES} bytes, so it is no config file")
    try:
        return tomllib.loads(raw.decode("utf-8"))
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{path}: not UTF-8 text (at line {line}), so it is no TOML file") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    except RecursionError as error:
        raise ConfigError(f"{path}: not valid TOML: brackets nested too deeply") from error


def toml_text(table: Mapping[str, Any]) -> str:
    """JSON-like values as TOML, one key a line and inner tables inline; there is no null in TOML: leave those out."""
    return "".join(f"{json.dumps(key)} = {_toml_value(value)}\n" for key, value in table.items())


def _toml_value(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{json.dumps(key)} = {_toml_value(item)}' for key, item in value.items())}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_toml_value, value))}]"
    if isinstance(value, float):
        return repr(value)  # TOML spells inf and nan as Python does
    return json.dumps(value, ensure_ascii=False)


def read_config_file(path: str | Path) -> ConfigFile:
    """Read a file given by ``--config``. Wrong top-level keys are left in `ConfigFile.errors`.

    Raises:
        ConfigError: see `read_toml`.
    """
    data = read_toml(path)
    errors = [
        f"{path}: {key}: there is no such table; {nearest(key, ('repr', 'fit', 'representation'))}"
        for key in data
        if key not in ("repr", "fit", "representation")
    ]
    name, tables = data.get("repr"), {key: data.get(key, {}) for key in ("fit", "representation")}
    if not (name is None or isinstance(name, str)):
        errors.append(f"{path}: repr: must be the name of a representation (got {shorten(name)})")
        name = None
    for key, table in tables.items():
        if not isinstance(table, dict):
            errors.append(f"{path}: {key}: must be a table of options (got {shorten(table)})")
            tables[key] = {}
    return ConfigFile(str(path), name, tables["fit"], tables["representation"], tuple(errors))
