"""`ndf field copy`: fields of one asset for another over the same base mesh."""

from __future__ import annotations

from pathlib import Path

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.paths import check_output
from ndf_core.cli.result import Result, as_lines


@click.command(short_help="Give fields of one asset to another over the same base mesh.")
@click.argument("source", metavar="FROM.ndf", type=click.Path(path_type=Path))
@click.argument("target", metavar="TO.ndf", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The asset to write, .ndf.")
@click.option(
    "--name", "names", required=True, multiple=True, help="Field to copy (ndf info lists them); repeatable."
)
@json_option
@debug_option
def command(source: Path, target: Path, output: Path, names: tuple[str, ...]) -> Result:
    """Write TO.ndf with fields of FROM.ndf, such as its colours.

    The two must have the same base mesh: one was fitted with `ndf fit --base-from` the other.
    """
    check_output(output, (".ndf",), source)

    from ndf_core.asset.asset import Asset
    from ndf_core.asset.transfer import copy_field

    given, result = Asset.load(source), Asset.load(target)
    for name in names:
        result = copy_field(given, result, name)
    report = {"fields": sorted(result.content.fields), "copied": list(names), "asset_bytes": result.save(output)}
    return Result(report, f"{output}\n{as_lines(report, '  ')}")
