"""Layers: who wins, and who is blamed."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from pydantic import BaseModel, ConfigDict, Field, model_validator

from ndf_core.api import RepresentationSpec
from ndf_core.cli import main
from ndf_core.config.fit import FitConfig, LossWeights
from ndf_core.config.recipes import recipe_names
from ndf_core.config.resolve import DeprecatedOption, Given, resolve_config, resolve_representation
from ndf_core.errors import ConfigError, PluginError

if TYPE_CHECKING:
    from tests.conftest import PluginMaker


class Inner(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    radius: float = Field(default=1.0, gt=0, description="radius")
    count: int = Field(default=3, ge=1, description="count")


class Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    iso: float = Field(default=0.0, description="iso value")
    path: str = Field(description="a required text")
    inner: Inner = Inner(count=9)

    @model_validator(mode="after")
    def _together(self) -> Config:
        if self.iso > 100:
            raise ValueError("iso lies outside the values of the grid")
        if self.iso < -100:
            raise KeyError("sloppy")
        return self


def spec(**training_defaults: Any) -> RepresentationSpec:
    return RepresentationSpec("blob", "A blob.", Config, "m:f", 1, "full", training_defaults)


def write(folder: Path, text: str) -> Path:
    path = folder / "fit.toml"
    path.write_text(text)
    return path


def on_command_line(fit: dict[str, Any] | None = None, representation: dict[str, Any] | None = None) -> Given:
    return Given(fit or {}, representation or {}, "command line", "--{}".format, "--{}".format)


def test_each_layer_lies_over_the_one_below(tmp_path: Path) -> None:
    plugin = spec(faces=11, feature_dim=11, seed=11, steps=11, loss={"cycle": 11.0})
    file = write(
        tmp_path, '[fit]\nrecipe = "paper"\nfeature_dim = 13\nseed = 13\n[representation]\npath = "p"\niso = 13'
    )
    given = on_command_line({"seed": "14"}, {"iso": "14", "inner.radius": "14"})
    resolved = resolve_config(plugin, given, file=file)
    fit, origins = resolved.fit.config, resolved.fit.origins
    assert (fit.faces, origins["faces"]) == (11, "training defaults of blob: faces")
    assert (fit.steps, origins["steps"]) == (10_000, "recipe paper: steps")
    assert (fit.feature_dim, origins["feature_dim"]) == (13, f"{file}: fit.feature_dim")
    assert (fit.seed, origins["seed"]) == (14, "command line: --seed")
    assert (fit.loss.cycle, origins["loss.cycle"]) == (11.0, "training defaults of blob: loss.cycle")
    assert (fit.loss.projection, origins["loss.projection"]) == (LossWeights().projection, "default")
    assert resolved.representation is not None
    assert resolved.representation.config == Config(iso=14, path="p", inner=Inner(radius=14, count=9))
    assert resolved.representation.origins["inner.count"] == "default"


def test_without_layers_the_config_is_the_recipe_fast() -> None:
    assert resolve_config().fit.config == resolve_config(given=Given({"recipe": "fast"})).fit.config


def test_the_highest_layer_that_names_a_recipe_decides(tmp_path: Path) -> None:
    file = write(tmp_path, '[fit]\nrecipe = "paper"')
    assert resolve_config(given=on_command_line({"recipe": "fast"}), file=file).fit.origins["recipe"] == (
        "command line: --recipe"
    )
    assert resolve_config(file=file).fit.config.steps == 10_000


@pytest.mark.parametrize("name", ["fast", "paper"])
def test_every_recipe_is_valid_and_leaves_the_loss_weights_to_the_plugin(name: str) -> None:
    assert name in recipe_names()
    resolved = resolve_config(spec(loss={"cycle": 5.0}), Given({"recipe": name}, {"path": "p"})).fit
    assert resolved.config.loss == LossWeights(cycle=5.0)


def test_everything_that_is_wrong_comes_at_once_each_with_its_origin(tmp_path: Path) -> None:
    file = write(
        tmp_path,
        'tables = 1\n[fit]\nsteps = -5\nsede = 3\nloss = 4\n[representation]\niso = "x"\npath = "p"\nraduis = 2',
    )
    with pytest.raises(ConfigError) as caught:
        resolve_config(spec(), on_command_line({"faces": "many"}, {"inner.count": "0"}), file=file)
    assert str(caught.value).splitlines() == [
        "8 wrong options:",
        f"  {file}: tables: there is no such table; there are repr, fit, representation",
        f"  {file}: fit.sede: there is no such option; did you mean seed?",
        f"  {file}: fit.loss: must be a table of options (got 4)",
        "  command line: --faces: input should be a valid integer, unable to parse string as an integer (got 'many')",
        f"  {file}: fit.steps: input should be greater than or equal to 0 (got -5)",
        f"  {file}: representation.raduis: there is no such option; did you mean inner.radius?",
        f"  {file}: representation.iso: input should be a valid number, unable to parse string as a number (got 'x')",
        "  command line: --inner.count: input should be greater than or equal to 1 (got '0')",
    ]


def test_a_wrong_value_that_a_higher_layer_replaces_does_no_harm(tmp_path: Path) -> None:
    file = write(tmp_path, "[fit]\nsteps = -5")
    assert resolve_config(given=on_command_line({"steps": "5"}), file=file).fit.config.steps == 5


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("option", ["loss.cycle", "loss.projection"])
def test_no_weight_is_infinite_or_undefined(option: str, value: str) -> None:
    with pytest.raises(ConfigError, match=f"command line: --{option}: "):
        resolve_config(given=on_command_line({option: value}))


def test_an_unknown_recipe_is_an_option_like_any_other() -> None:
    with pytest.raises(ConfigError, match="command line: --recipe: input should be 'fast' or 'paper'"):
        resolve_config(given=on_command_line({"recipe": "slow"}))


def test_errors_of_several_options_together_name_where_they_came_from() -> None:
    with pytest.raises(ConfigError, match="command line: --iso, command line: --path: iso lies outside the values"):
        resolve_config(spec(), on_command_line(representation={"iso": "101", "path": "p"}))


def test_a_missing_required_option_says_how_to_give_it() -> None:
    with pytest.raises(ConfigError, match="path: is required; give --path or `path` in the config file"):
        resolve_config(spec())


def test_a_validator_that_crashes_is_the_plugins_fault() -> None:
    with pytest.raises(PluginError, match="--repr blob: the plugin failed to check its options: KeyError: 'sloppy'"):
        resolve_representation(spec(), {"iso": -101, "path": "p"})


def test_tables_may_be_given_as_mappings_models_or_dotted_keys() -> None:
    given: list[dict[str, Any]] = [{"loss": {"cycle": 7}}, {"loss": LossWeights(cycle=7)}, {"loss.cycle": 7}]
    assert {resolve_config(given=Given(options)).fit.config.loss for options in given} == {LossWeights(cycle=7)}


def test_defaults_of_the_config_model_are_valid() -> None:
    assert FitConfig.model_validate(FitConfig().model_dump()) == FitConfig()


class Renamed(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    spacing: float = Field(default=1.0, description="distance of two columns")
    step: float | None = Field(default=None, description="old name", deprecated="use spacing")


def test_a_deprecated_option_warns_with_its_origin_and_only_where_it_is_given() -> None:
    renamed = replace(spec(), config=Renamed)
    with pytest.warns(DeprecatedOption, match=r"^arguments: step: this option is deprecated: use spacing$"):
        resolve_representation(renamed, {"step": 2.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert resolve_representation(renamed, {"spacing": 2.0}) == Renamed(spacing=2.0)


def test_ndf_fit_says_that_an_option_is_deprecated(
    plugin_maker: PluginMaker, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    plugin_maker.add("blob", replace={'description="Newton steps"': 'description="x", deprecated="use resolution"'})
    assert main(["fit", "--repr", "blob", "--help"]) == 0
    assert "deprecated: use resolution]" in " ".join(capfd.readouterr().out.split())
    (tmp_path / "x.blob").write_text("blob crash")
    assert main(["fit", str(tmp_path / "x.blob"), "-o", str(tmp_path / "x.ndf"), "--blob.steps", "3"]) == 3
    said = "warning: command line: --blob.steps: this option is deprecated: use resolution"
    assert said in capfd.readouterr().err.splitlines()
