"""`ndf plugins`: the installed representations."""

from __future__ import annotations

from dataclasses import asdict

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.result import Result
from ndf_core.plain_json import as_json
from ndf_core.plugins.discovery import EXPORTERS, GROUP, OBSERVERS, not_installed

KINDS = {"representations": GROUP, "exporters": EXPORTERS, "observers": OBSERVERS}


@click.command(short_help="List the installed representations, or check them.")
@click.argument("name", required=False)
@click.argument("source", required=False)
@click.option("--check", is_flag=True, help="Import each with all it needs, in a process of its own; see above.")
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    help="Seconds for each check; 60 if left out, 600 for all laws of NAME.",
)
@click.option("--schema", metavar="NAME", help="Print the JSON schema of a config file for this representation.")
@click.option(
    "--kind",
    type=click.Choice(list(KINDS)),
    default="representations",
    help="What to list: representations (the default), exporters of ndf extract, observers of ndf fit.",
)
@json_option
@debug_option
def command(
    name: str | None, source: str | None, check: bool, timeout: float | None, schema: str | None, kind: str
) -> Result:
    """List the installed representations from their metadata; --check imports them and says what is wrong.

    --check NAME goes on to the laws of ndf_core.testing: of the plugin alone, or with a SOURCE, a small file that it
    reads, of the surface too.
    """
    if schema is not None:
        return _schema(schema)
    if name is not None:
        if not check:
            raise click.UsageError("NAME is for --check: ndf plugins --check NAME [SOURCE]")
        return _conformance(name, source, timeout)
    from ndf_core.plugins.checking import CHECK_SECONDS, Status, check_plugins, list_plugins

    group = KINDS[kind]
    found = check_plugins(timeout or CHECK_SECONDS, group) if check else list_plugins(group)

    def line(state: Status) -> str:
        cause = f"  {state.error}" if state.error else ""
        return f"{state.name:<18} {state.status:<7} {state.distribution} {state.version}{cause}"

    absent = not_installed() if group == GROUP else {}
    missing = [f"{name:<18} not installed: pip install {owner}" for name, owner in absent.items()]
    return Result([asdict(state) for state in found], "\n".join([*map(line, found), *missing]))


def _conformance(name: str, source: str | None, timeout: float | None) -> Result:
    from ndf_core.plugins.conformance import CONFORMANCE_SECONDS, check_conformance

    outcomes = check_conformance(name, source, timeout or CONFORMANCE_SECONDS)
    failed = sum(outcome["status"] == "failed" for outcome in outcomes)
    lines = [
        f"{outcome['check']:<40} {outcome['status']:<7} {outcome['message']}".rstrip()
        + (f" [{outcome['reason']}]" if outcome["status"] == "failed" else "")
        for outcome in outcomes
    ]
    skipped = sum(outcome["status"] == "skipped" for outcome in outcomes)
    lines.append(f"{len(outcomes)} laws: {failed} broken, {skipped} not asked")
    data = {"name": name, "source": source, "failed": failed, "checks": outcomes}
    return Result(data, "\n".join(lines), exit_code=3 if failed else 0)


def _schema(name: str) -> Result:
    from ndf_core.config.schema import config_schema
    from ndf_core.plugins.loading import load

    schema = config_schema(load(name))
    return Result(schema, as_json(schema))
