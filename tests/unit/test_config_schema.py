"""The schema for editors accepts what the loader accepts."""

from __future__ import annotations

import json

from pydantic import BaseModel, ConfigDict, Field

from ndf_core.api import RepresentationSpec
from ndf_core.config.schema import config_schema


class Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    size: float = Field(default=1.0, gt=0, description="size")


class Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    needed: int = Field(ge=2, description="needed")
    table: Table = Table()


def test_both_tables_with_bounds_nothing_required_and_every_reference_resolved() -> None:
    schema = config_schema(RepresentationSpec("blob", "A blob.", Config, "m:f", 1, "full"))
    fit, mine = schema["properties"]["fit"], schema["properties"]["representation"]
    assert fit["properties"]["faces"]["minimum"] == 4
    assert mine["properties"]["needed"]["minimum"] == 2
    assert mine["additionalProperties"] is False
    assert "required" not in mine
    assert schema["properties"]["repr"]["const"] == "blob"
    text = json.dumps(schema)
    references = {part.partition('"')[0] for part in text.split('"$ref": "#/$defs/')[1:]}
    assert references == {"fit.LossWeights", "representation.Table"}
    assert references <= schema["$defs"].keys()
