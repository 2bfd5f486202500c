"""From models to command-line options and back: what is typed arrives as pydantic would have it from a file."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Any, Literal

import click
import pytest
from pydantic import BaseModel, ConfigDict, Field

from ndf_core.cli.options import option_group


class Colour(Enum):
    RED = "red"
    GREEN = "green"


class Grid(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    voxel_size: float = Field(default=0.5, gt=0, description="size of a voxel")


class Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    count: int = Field(default=3, ge=1, le=9, description="count")
    ratio: float | None = Field(default=None, description="ratio")
    name: str = Field(default="", description="name")
    path: Path | None = Field(default=None, description="path")
    mode: Literal["a", "b"] = Field(default="a", description="mode")
    order: Literal[1, 2] = Field(default=1, description="order")
    colour: Colour = Field(default=Colour.RED, description="colour")
    corner: tuple[float, float, float] | None = Field(default=None, description="corner")
    names: list[str] = Field(default=[], description="names")
    weights: dict[str, float] = Field(default={}, description="weights")
    flag: bool = Field(default=True, description="flag")
    grid: Grid = Grid(voxel_size=0.25)
    output: str = Field(default="", description="collides with --output")


GROUP = option_group(Model, "Options", frozenset({"--output"}), "my-repr", {"count": 5})


def given(*arguments: str) -> dict[str, Any]:
    found: dict[str, Any] = {}

    def callback(**parameters: Any) -> None:
        found.update(GROUP.given(parameters))

    command = click.Command("x", params=list(GROUP.options), callback=callback)
    command.main(args=list(arguments), standalone_mode=False)
    return found


@pytest.mark.parametrize(
    ("arguments", "key", "value"),
    [
        (["--count", "4"], "count", 4),
        (["--ratio", "-0.5"], "ratio", -0.5),
        (["--ratio", "none"], "ratio", None),
        (["--name", "12"], "name", "12"),
        (["--name", "[1, 2]"], "name", "[1, 2]"),
        (["--name="], "name", ""),
        (["--path", "a/b"], "path", Path("a/b")),
        (["--mode", "b"], "mode", "b"),
        (["--order", "2"], "order", 2),
        (["--colour", "green"], "colour", Colour.GREEN),
        (["--corner", "-1,0,2.5"], "corner", (-1.0, 0.0, 2.5)),
        (["--corner", "[-1, 0, 2.5]"], "corner", (-1.0, 0.0, 2.5)),
        (["--names", '["a", "b"]'], "names", ["a", "b"]),
        (["--weights", "{a = 1.5}"], "weights", {"a": 1.5}),
        (["--no-flag"], "flag", False),
        (["--grid.voxel-size", "2"], "grid.voxel_size", 2.0),
        (["--my-repr.output", "x"], "output", "x"),
    ],
)
def test_what_is_typed_arrives(arguments: list[str], key: str, value: object) -> None:
    options = given(*arguments)
    assert list(options) == [key]
    table, _, field = key.rpartition(".")
    model = Model.model_validate({table: {field: options[key]}} if table else options)
    assert getattr(getattr(model, table) if table else model, field) == value


def test_what_is_not_typed_is_left_to_the_layers_below() -> None:
    assert given() == {}


def test_help_shows_type_bounds_and_the_effective_default() -> None:
    context = click.Context(click.Command("x"))
    records = dict(record for option in GROUP.options if (record := option.get_help_record(context)))
    assert records["--count INTEGER"] == "count  [default: 5; >= 1, <= 9]"
    assert records["--grid.voxel-size NUMBER"] == "size of a voxel  [default: 0.25; > 0]"
    assert records["--mode [a|b]"] == "mode  [default: a]"
    assert records["--colour [red|green]"] == "colour  [default: red]"
    assert records["--flag / --no-flag"] == "flag  [default: True]"
    assert GROUP.spell("grid.voxel_size") == "--grid.voxel-size"
    assert GROUP.spell("output") == "--my-repr.output"
