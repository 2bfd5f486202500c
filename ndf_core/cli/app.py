"""The command group. A command's module is imported when the command runs, never for the list of commands."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import click

COMMANDS = {
    "fit": "Fit a surface that is not a mesh and write the asset.",
    "extract": "Extract a triangle mesh from an asset.",
    "geodesics": "Distances along a surface from given points.",
    "heat": "Heat spreading over a surface from given points.",
    "directions": "The smoothest direction field of a surface.",
    "stripes": "Evenly spaced stripes on a surface.",
    "logmap": "The surface as seen from one of its points.",
    "spectrum": "Lowest eigenvalues and eigenfunctions of a surface.",
    "field": "Learned fields on an asset's surface: fit, eval, copy.",
    "sample": "Points spread over an asset's surface.",
    "info": "Show what an asset holds.",
    "plugins": "List the installed representations, or check them.",
    "new-plugin": "Write a plugin package to start from.",
}
"""Name and help of each command; the module `ndf_core.cli.<name>`, with _ for -, has a `command`."""


class LazyGroup(click.Group):
    """A group that knows its commands by name alone."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        return import_module(f"ndf_core.cli.{cmd_name.replace('-', '_')}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


def _version(ctx: click.Context, _param: click.Parameter, wanted: bool) -> None:
    if wanted:
        from ndf_core import __version__

        click.echo(f"ndf {__version__}")
        ctx.exit()


def debug_option(command: Any) -> Any:
    """``--debug``, accepted before and after the command's name; `guard` reads it from the arguments."""
    return click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")(command)


def json_option(command: Any) -> Any:
    """``--json``, which `guard` reads from the arguments: a command returns a result and never prints it itself."""
    text = "Print one JSON object on stdout, everything else on stderr."
    return click.option("--json", "json_", is_flag=True, expose_value=False, help=text)(command)


@click.group(
    cls=LazyGroup, name="ndf", context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 118}
)
@click.option(
    "--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show the version."
)
@debug_option
def ndf() -> None:
    """Small assets from surfaces that are not meshes, and clean meshes from the assets."""
