"""The click command of `ndf fit`, whose options depend on the representation, which may depend on the input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import click

from ndf_core.api import RepresentationSpec
from ndf_core.cli.options import OptionGroup, option_group
from ndf_core.config.fit import FitConfig
from ndf_core.config.layers import merge
from ndf_core.config.resolve import Given, fit_layers
from ndf_core.config.toml import ConfigFile, read_config_file
from ndf_core.plugins.choosing import Choice, choose
from ndf_core.plugins.discovery import entries
from ndf_core.plugins.loading import load, load_usable

PLAN = "ndf_core.cli.plan"


@dataclass(frozen=True)
class Plan:
    """What a first look at the arguments says."""

    fit: OptionGroup
    representation: OptionGroup | None
    spec: RepresentationSpec | None
    """None only where help is asked for without a representation, or INPUT is missing."""
    choice: Choice | None
    """Set where the representation was found by looking at INPUT."""
    file: ConfigFile | None

    @property
    def groups(self) -> list[OptionGroup]:
        return [self.fit, *([self.representation] if self.representation else [])]

    def given(self, parameters: dict[str, Any]) -> Given:
        """The top layer of the configuration."""
        if self.representation is None:
            return Given(self.fit.given(parameters), {}, "command line", self.fit.spell)
        theirs = self.representation
        return Given(
            self.fit.given(parameters), theirs.given(parameters), "command line", self.fit.spell, theirs.spell
        )


class FitCommand(click.Command):
    """Adds the options of `FitConfig` and of the representation while it parses."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[PLAN] = self._plan(ctx, args)
        return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        plan: Plan | None = ctx.meta.get(PLAN)
        dynamic = [option for group in plan.groups for option in group.options] if plan else []
        return [*super().get_params(ctx), *dynamic]

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        plan: Plan = ctx.meta[PLAN]
        mine = [param for param in super().get_params(ctx) if isinstance(param, click.Option)]
        _section(ctx, formatter, "Options", mine)
        for group in plan.groups:
            _section(ctx, formatter, group.title, group.options)
        if plan.spec is None:
            names = ", ".join(dict.fromkeys(entry.name for entry in entries())) or "none installed"
            with formatter.section("Options of a representation"):
                formatter.write_text(f"ndf fit --repr NAME --help, where NAME is one of: {names}")

    def _plan(self, ctx: click.Context, args: Sequence[str]) -> Plan:
        taken = frozenset(word for param in super().get_params(ctx) for word in param.opts)
        fit = option_group(FitConfig, "Fit options", taken, "fit", {})
        seen = self._peek(ctx, args, fit.options)
        file = read_config_file(seen["config"]) if "config" in seen else None
        name = seen.get("repr_") or (file.repr if file else None)
        choice = None
        if name:
            spec = load(name)
        elif self._helps(ctx) in seen or (source := self._source(ctx, args, fit, taken)) is None:
            spec = None
        else:
            choice = choose(source)
            spec = choice.spec
        layers = fit_layers(spec, Given({"recipe": seen["fit_recipe"]} if "fit_recipe" in seen else {}), file)
        fit = option_group(FitConfig, "Fit options", taken, "fit", merge(FitConfig, layers).values)
        return Plan(fit, _theirs(spec, fit, taken) if spec else None, spec, choice, file)

    def _helps(self, ctx: click.Context) -> str:
        """click's name for the value of ``--help``."""
        option = self.get_help_option(ctx)
        return "" if option is None else str(option.name)

    def _source(self, ctx: click.Context, args: Sequence[str], fit: OptionGroup, taken: frozenset[str]) -> str | None:
        """INPUT, which can be told from the value of an option only when all plugins' options are known."""
        every = {option.opts[0]: option for spec in load_usable()[0] for option in _theirs(spec, fit, taken).options}
        source = self._peek(ctx, args, [*fit.options, *every.values()]).get("source")
        return None if source is None or source.startswith("-") else source

    def _peek(self, ctx: click.Context, args: Sequence[str], options: Sequence[click.Option]) -> dict[str, str]:
        """What the arguments give, without complaint about the rest; the real parser complains later."""
        parser = click.Command("fit", params=[*super().get_params(ctx), *options]).make_parser(ctx)
        parser.ignore_unknown_options = True
        try:
            values = parser.parse_args(list(args))[0]
        except click.UsageError:
            return {}
        return {name: str(value) for name, value in values.items() if isinstance(value, str) or value is True}


def _theirs(spec: RepresentationSpec, fit: OptionGroup, taken: frozenset[str]) -> OptionGroup:
    words = taken | {word for option in fit.options for word in option.opts}
    title = f"Options of --repr {spec.name} ({spec.summary.rstrip('.')})"
    return option_group(spec.config, title, words, spec.name, {})


def _section(
    ctx: click.Context, formatter: click.HelpFormatter, title: str, params: Sequence[click.Parameter]
) -> None:
    records = [record for param in params if (record := param.get_help_record(ctx)) is not None]
    with formatter.section(title):
        formatter.write_dl(records or [("", "none")])
