"""Write the pages of docs/reference that are made from the program: cli.md, config.md, laws.md.

    python tools/docs_reference.py

A test compares the pages with what this makes of the program as it is.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from pydantic import BaseModel

from ndf_core.cli.app import COMMANDS, ndf
from ndf_core.cli.fit_command import PLAN, FitCommand
from ndf_core.config.fields import REQUIRED, leaves
from ndf_core.config.fit import FitConfig
from ndf_core.plugins.discovery import OWNERS
from ndf_core.plugins.loading import load
from ndf_core.testing.checks import CHECKS

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference"
_WIDTH = 100
_DYNAMIC = "Fit options", "Options of"
"""Sections of `ndf fit --help` that the page of options shows as tables."""


def pages() -> dict[str, str]:
    """Text by file name."""
    return {"cli.md": cli_page(), "config.md": config_page(), "laws.md": laws_page()}


def cli_page() -> str:
    """Help of every command; options of fits and representations are on their own page."""
    parts = ["# Command line\n", "Made from `--help` of every command, by `python tools/docs_reference.py`.\n"]
    for path, command in _commands("ndf", ndf):
        parts += [f"## {path}\n", f"```text\n{_help(path, command)}\n```\n"]
        if path == "ndf fit":
            parts.append("Options of the fit itself and of each representation: [Options](config.md).\n")
    return "\n".join(parts)


def config_page() -> str:
    """Every option with its type, default and bounds, as in `ndf fit --help`."""
    parts = [
        "# Options\n",
        "Each is an option of `ndf fit` (`steps` is `--steps`, `loss.cycle` is `--loss.cycle`), a key of a config "
        "file and a keyword of `ndf_core.fit` or `ndf_core.open`. Made by `python tools/docs_reference.py`.\n",
        "## The fit\n",
        "In the table `[fit]` of a config file.\n",
        _table(FitConfig),
    ]
    for name in OWNERS:
        spec = load(name)
        parts += [f"## {name}\n", f"{spec.summary[0].upper()}{spec.summary[1:].rstrip('.')}.", ""]
        parts += ["In the table `[representation]` of a config file.\n", _table(spec.config)]
    return "\n".join(parts)


def laws_page() -> str:
    """Every check of the conformance kit with its reason."""
    lines = [
        "# Laws",
        "",
        "What `ndf_core.testing` checks, in this order. A law that cannot be judged before another one holds is not "
        "asked until it does. Made by `python tools/docs_reference.py`.",
        "",
        "| law | why |",
        "|---|---|",
        *(f"| `{check.name}` | {check.reason} |" for check in CHECKS),
        "",
    ]
    return "\n".join(lines)


def _commands(path: str, command: click.Command) -> Iterator[tuple[str, click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in COMMANDS if command is ndf else command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from _commands(f"{path} {name}", inner)


def _help(path: str, command: click.Command) -> str:
    """What `--help` prints, without the sections of options that have a page of their own."""
    # Click keeps the help option of a command as the first context named it: name it as the program does.
    names = ndf.context_settings["help_option_names"]
    context = click.Context(
        command, info_name=path, help_option_names=names, max_content_width=_WIDTH, terminal_width=_WIDTH
    )
    if isinstance(command, FitCommand):
        context.meta[PLAN] = command._plan(context, ["--help"])  # pyright: ignore[reportPrivateUsage]
    text = command.get_help(context)
    if path == "ndf fit":
        head, *sections = text.split("\n\n")
        text = "\n\n".join([head, *(part for part in sections if not part.startswith(_DYNAMIC))])
    return text.strip()


def _table(model: type[BaseModel]) -> str:
    if not leaves(model):
        return "None.\n"
    lines = ["| option | default | |", "|---|---|---|"]
    for key, leaf in leaves(model).items():
        bounds = ", ".join(_bounds(leaf.info.metadata))
        text = f"{leaf.info.description} ({bounds})" if bounds else str(leaf.info.description)
        text = f"*Deprecated: {leaf.info.deprecated}.* {text}" if leaf.info.deprecated else text
        lines.append(f"| `{key}` | {_shown(leaf.default)} | {text.replace('|', chr(92) + '|')} |")
    return "\n".join([*lines, ""])


def _bounds(metadata: list[Any]) -> Iterator[str]:
    signs = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
    for item in metadata:
        for name, words in signs.items():
            value = getattr(item, name, None)
            if value is not None:
                yield f"{words} {value:g}" if isinstance(value, float) else f"{words} {value}"


def _shown(value: Any) -> str:
    if value is REQUIRED:
        return "required"
    if isinstance(value, float):
        return f"`{value:.6g}`"
    return "none" if value is None else f"`{str(value).lower() if isinstance(value, bool) else value}`"


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / name).write_text(text, "utf-8")
    sys.exit()
