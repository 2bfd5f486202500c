"""`ndf new-plugin`: the start of a representation of one's own."""

from __future__ import annotations

from pathlib import Path

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.result import Result


@click.command(short_help="Write a plugin package to start from.")
@click.argument("name")
@click.option(
    "--folder",
    type=click.Path(path_type=Path),
    default=Path(),
    help="Where to write it; here if left out.",
)
@json_option
@debug_option
def command(name: str, folder: Path) -> Result:
    """Write the package ndf-plugin-NAME: a representation that works, its tests, and a CI workflow.

    NAME will be the value of --repr. The package installs and passes its tests as it is.
    """
    from ndf_core.scaffold.write import write_plugin

    written = write_plugin(name, folder)
    root = folder / f"ndf-plugin-{name}"
    names = "\n".join(f"  {path.relative_to(root)}" for path in written)
    steps = f"cd {root}\n  pip install --editable '.[test]'\n  pytest"
    return Result([str(path) for path in written], f"{root}\n{names}\n\nGo on with:\n  {steps}")
