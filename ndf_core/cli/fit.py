"""`ndf fit`: from an input to an asset."""

from __future__ import annotations

import shlex
import sys
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.fit_command import PLAN, FitCommand, Plan
from ndf_core.cli.paths import check_output
from ndf_core.cli.result import Interrupted, Result, as_lines
from ndf_core.config.resolve import DeprecatedOption, resolve_config
from ndf_core.plugins.opening import open_surface

if TYPE_CHECKING:
    from ndf_core.config.fit import FitConfig
    from ndf_core.interfaces import Surface

SUFFIX = ".ndf"


@click.command(cls=FitCommand, short_help="Fit a surface that is not a mesh and write the asset.")
@click.argument("source", metavar="INPUT")
@click.option("--repr", "repr_", metavar="NAME", help="Representation of INPUT; without it the file is looked at.")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The asset to write, .ndf.")
@click.option("--config", type=click.Path(), help="TOML file with [fit] and [representation]; below these options.")
@click.option(
    "--observe",
    multiple=True,
    metavar="NAME[:TARGET]",
    help="Follow the fit: jsonl:FILE, tensorboard:FOLDER, wandb:PROJECT, or an installed observer; repeatable.",
)
@click.option("--resume", is_flag=True, help="Go on from the checkpoint that an interrupted run left beside OUTPUT.")
@click.option("--quiet", is_flag=True, help="No progress and no remarks.")
@json_option
@debug_option
@click.pass_context
def command(
    ctx: click.Context,
    source: str,
    repr_: str | None,
    output: Path,
    config: str | None,
    observe: tuple[str, ...],
    resume: bool,
    quiet: bool,
    **options: Any,
) -> Result:
    """Fit INPUT, a surface that is not a mesh, and write the asset.

    INPUT is a file, or module:callable for the representations that take one.
    """
    plan: Plan = ctx.meta[PLAN]  # repr_ and config are in it
    spec = plan.spec
    assert spec is not None, "click has refused a missing INPUT"
    given = plan.given(options)
    with warnings.catch_warnings(record=True) as deprecated:
        warnings.simplefilter("always", DeprecatedOption)
        resolved = resolve_config(spec, given, file=plan.file)
    if not quiet:
        _say(*(f"warning: {found.message}" for found in deprecated))
    check_output(output, (SUFFIX,), Path(source))
    if plan.choice and not quiet:
        _say(*plan.choice.warnings, plan.choice.note)
    assert resolved.representation is not None
    surface = open_surface(spec, source, resolved.representation.config)
    if surface.training_defaults != spec.training_defaults:
        resolved = resolve_config(spec, given, file=plan.file, training_defaults=surface.training_defaults)
    if not quiet:
        _say(*surface.notes, *_overwritten(output, resume))
    report = _run(surface, resolved.fit.config, output, resume, quiet, observe, ctx.obj)
    return Result(report, f"{output}\n{as_lines(report, '  ')}")


def _run(
    surface: Surface,
    config: FitConfig,
    output: Path,
    resume: bool,
    quiet: bool,
    observe: Sequence[str],
    arguments: Sequence[str],
) -> Mapping[str, Any]:
    """The fit itself; torch is imported here."""
    from ndf_core.cli.progress import make_observer
    from ndf_core.fitting.observer import Observers
    from ndf_core.fitting.pipeline import run_fit
    from ndf_core.plugins.companions import open_observers

    followers = open_observers(observe)
    try:
        with make_observer(quiet) as shown:
            observers = Observers([*([shown] if shown else []), *followers])
            return run_fit(surface, config, output=output, resume=resume, observer=observers).report
    except KeyboardInterrupt:
        raise Interrupted(_how_to_resume(output, arguments)) from None


def _overwritten(output: Path, resume: bool) -> list[str]:
    if resume or not _checkpoint(output).exists():
        return []
    return [f"{_checkpoint(output)}: left by an interrupted run; this one starts anew (--resume would go on)"]


def _checkpoint(output: Path) -> Path:
    """Where `ndf_core.fitting` keeps it."""
    return Path(f"{output}.checkpoint")


def _how_to_resume(output: Path, arguments: Sequence[str]) -> str:
    if not _checkpoint(output).exists():
        return "interrupted before the first checkpoint; nothing is left behind"
    words = [*arguments, *([] if "--resume" in arguments else ["--resume"])]
    return f"interrupted; go on with: {shlex.join(['ndf', *words])}"


def _say(*lines: str) -> None:
    for line in lines:
        print(line, file=sys.stderr)
