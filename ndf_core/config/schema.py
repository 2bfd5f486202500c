"""JSON schema of a config file, for editors that complete and check TOML while it is written."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from ndf_core.api import RepresentationSpec
from ndf_core.config.fit import FitConfig


def config_schema(spec: RepresentationSpec) -> dict[str, Any]:
    """Schema of a file for ``ndf fit --repr NAME --config FILE``.

    No option is required in the file: any of them may come from another layer.
    """
    definitions: dict[str, Any] = {}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"ndf fit --repr {spec.name}",
        "description": spec.summary,
        "type": "object",
        "additionalProperties": False,
        "properties": {
            "repr": {"const": spec.name, "description": "the representation, as --repr"},
            "fit": _optional(FitConfig, "fit", definitions),
            "representation": _optional(spec.config, "representation", definitions),
        },
        "$defs": definitions,
    }


def _optional(model: type[BaseModel], prefix: str, definitions: dict[str, Any]) -> dict[str, Any]:
    """The model's schema without `required`, its definitions moved to `definitions` under names of its own."""
    schema = model.model_json_schema(ref_template=f"#/$defs/{prefix}.{{model}}")
    for name, definition in schema.pop("$defs", {}).items():
        definitions[f"{prefix}.{name}"] = definition
    schema.pop("required", None)
    return schema
