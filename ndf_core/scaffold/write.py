"""Writing the template."""

from __future__ import annotations

import keyword
import re
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from ndf_core.errors import ConfigError, OutputError
from ndf_core.plugins.discovery import OWNERS

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_OWN_MODULES = ("opening", "extractor", "projector")
"""Of the template."""


def write_plugin(name: str, parent: Path) -> list[Path]:
    """Write the distribution ``ndf-plugin-<name>`` into a new folder of that name in `parent`; the files written.

    Raises:
        ConfigError: the name is no name of a representation, or taken by ndf's own plugins.
        OutputError: the folder exists already, or cannot be made.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(f"{name}: must be lower-case letters, digits and hyphens, and begin with a letter")
    if name in OWNERS:
        raise ConfigError(f"{name}: is the name of a representation of {OWNERS[name]}; take another one")
    module = name.replace("-", "_")
    if keyword.iskeyword(module) or module in _OWN_MODULES:
        raise ConfigError(f"{name}: cannot be the name of a module beside the others; take another one")
    distribution = f"ndf-plugin-{name}"
    words = {"name": name, "module": module, "package": f"ndf_plugin_{module}", "distribution": distribution}
    root = parent / distribution
    try:
        root.mkdir(parents=True)
        return list(_written(files("ndf_core.scaffold") / "template", root, words))
    except FileExistsError as error:
        raise OutputError(f"{root}: exists already; move it away or take another name") from error
    except OSError as error:
        raise OutputError(f"{root}: cannot be written: {error.strerror or error}") from error


def _written(source: Traversable, target: Path, words: dict[str, str]) -> list[Path]:
    target.mkdir(exist_ok=True)
    found: list[Path] = []
    for entry in sorted(source.iterdir(), key=lambda entry: entry.name):
        path = target / _filled(entry.name, words)
        if entry.is_dir():
            found += _written(entry, path, words)
        elif entry.name.endswith(".in"):
            path = path.with_name(path.name.removesuffix(".in"))
            path.write_text(_filled(entry.read_text("utf-8"), words), "utf-8")
            found.append(path)
    return found


def _filled(text: str, words: dict[str, str]) -> str:
    for word, value in {**words, "dot": "."}.items():  # package data leaves out names that begin with a dot
        text = text.replace(f"@{word}@", value)
    return text
