"""`ndf field`: learned fields on an asset's surface."""

from __future__ import annotations

from importlib import import_module

import click

_COMMANDS = {
    "fit": "Learn a field from values on a mesh or at points, into an asset.",
    "eval": "Evaluate a field of an asset on an extracted mesh, or at points.",
    "copy": "Give fields of one asset to another over the same base mesh.",
}


class _Group(click.Group):
    """Knows its commands by name alone; the module `ndf_core.cli.field_<name>` has a `command`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return import_module(f"ndf_core.cli.field_{cmd_name}").command if cmd_name in _COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_COMMANDS.items()))


@click.group(cls=_Group, short_help="Learned fields on an asset's surface.")
def command() -> None:
    """Fields learned over an asset's base mesh: any values on the surface, in a few KB (Sec. 3.5)."""
