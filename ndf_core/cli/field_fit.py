"""`ndf field fit`: learn a field into an asset."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.options import option_group
from ndf_core.cli.paths import check_output
from ndf_core.cli.result import Result, as_lines
from ndf_core.config.field import FieldConfig
from ndf_core.config.resolve import resolve_options

_GROUP = option_group(FieldConfig, "Field options", frozenset(), "field", {})


@click.command(short_help="Learn a field from values on a mesh or at points, into an asset.")
@click.argument("asset", metavar="ASSET.ndf", type=click.Path(path_type=Path))
@click.argument("source", metavar="VALUES", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The asset to write, .ndf.")
@click.option("--name", required=True, help="Name of the field in the asset.")
@click.option("--values", "names", multiple=True, metavar="NAME", help="Array or property of VALUES; repeatable.")
@click.option("--label", "labels", multiple=True, help="Name of a column, or of a class, in order; repeatable.")
@json_option
@debug_option
def command(
    asset: Path,
    source: Path,
    output: Path,
    name: str,
    names: tuple[str, ...],
    labels: tuple[str, ...],
    **options: Any,
) -> Result:
    """Learn a field on the surface of ASSET.ndf and write the asset with it.

    VALUES is an .npz with `vertices` and `faces`, or `points`, and the values, as other ndf commands write it; or a
    .ply with further properties. Several columns become several fields, or the parts of a vector, in one network.
    """
    check_output(output, (".ndf",), source)
    config = resolve_options(FieldConfig, _GROUP.given(options), _GROUP.spell)

    from ndf_core.asset.asset import Asset
    from ndf_core.fitting.field_fit import fit_field
    from ndf_core.fitting.field_values import FieldValues
    from ndf_core.readers.values_file import read_values

    found = read_values(source, names)
    values = FieldValues(found.points, found.values, found.faces)
    threads = os.cpu_count() or 1
    result = fit_field(Asset.load(asset), values, name, config, labels or found.names, threads)
    result.asset.save(output)
    return Result(result.report, f"{output}\n{as_lines(result.report, '  ')}")


command.params.extend(_GROUP.options)
