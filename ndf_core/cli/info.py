"""`ndf info`: what an asset holds."""

from __future__ import annotations

from pathlib import Path

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.result import Result, as_lines


@click.command(short_help="Show what an asset holds.")
@click.argument("asset", metavar="ASSET.ndf", type=click.Path(path_type=Path))
@json_option
@debug_option
def command(asset: Path) -> Result:
    """Show what ASSET.ndf holds: base mesh, fields, frame, provenance and measured errors."""
    from ndf_core.asset.asset import Asset

    found = Asset.load(asset).info()
    return Result(found, f"{asset}\n{as_lines(found, '  ')}")
