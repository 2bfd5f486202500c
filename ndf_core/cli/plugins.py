"""`ndf plugins`: the installed representations."""

from __future__ import annotations

from dataclasses import asdict

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.result import Result, as_json


@click.command(short_help="List the installed representations, or check them.")
@click.option("--check", is_flag=True, help="Import each with all it needs, in a process of its own.")
@click.option(
    "--timeout", type=click.FloatRange(min=0, min_open=True), help="Seconds for each check; 60 if left out."
)
@click.option("--schema", metavar="NAME", help="Print the JSON schema of a config file for this representation.")
@json_option
@debug_option
def command(check: bool, timeout: float | None, schema: str | None) -> Result:
    """List the installed representations from their metadata; --check imports them and says what is wrong."""
    if schema is not None:
        return _schema(schema)
    from ndf_core.plugins.checking import CHECK_SECONDS, Status, check_plugins, list_plugins

    found = check_plugins(timeout or CHECK_SECONDS) if check else list_plugins()

    def line(state: Status) -> str:
        cause = f"  {state.error}" if state.error else ""
        return f"{state.name:<18} {state.status:<7} {state.distribution} {state.version}{cause}"

    text = "\n".join(map(line, found)) or "no plugin is installed; try: pip install ndf-plugin-sdf"
    return Result([asdict(state) for state in found], text)


def _schema(name: str) -> Result:
    from ndf_core.config.schema import config_schema
    from ndf_core.plugins.loading import load

    schema = config_schema(load(name))
    return Result(schema, as_json(schema))
