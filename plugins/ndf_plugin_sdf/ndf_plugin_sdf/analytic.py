"""``--repr analytic``: solids given by formulas, as a CSG tree or as a function."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_plugin_sdf.defaults import API_VERSION, COSTLY_TRAINING_DEFAULTS

_CALLABLE = re.compile(r"(?:[A-Za-z_][\w.]*|.+\.py):[A-Za-z_][\w.]*")
_MOST_BYTES = 4 << 20

Finite = Annotated[float, Field(allow_inf_nan=False)]
Corner = tuple[Finite, Finite, Finite]


class AnalyticConfig(BaseModel):
    """Options of `analytic`. Lengths are in the input's units."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    bounds: tuple[Corner, Corner] | None = Field(
        None,
        description="box that holds the surface: [[x, y, z], [x, y, z]]. A function needs it, or an attribute "
        "`bounds`; a CSG tree finds its own unless it is unbounded",
    )
    lipschitz: float | None = Field(
        None,
        gt=0,
        allow_inf_nan=False,
        description="bound of |phi| / distance to the surface; a CSG tree knows its own, that of a function is "
        "estimated from samples",
    )
    resolution: int = Field(256, ge=16, le=1024, description="cells of the base mesh's grid along the longest side")
    corrections: int = Field(
        2,
        ge=0,
        le=20,
        description="most steps from a projection towards the closest point, where the field is no distance",
    )

    @model_validator(mode="after")
    def _is_box(self) -> AnalyticConfig:
        if self.bounds is not None and not all(low < high for low, high in zip(*self.bounds, strict=True)):
            raise ValueError("bounds: each coordinate of the first corner must be below that of the second")
        return self


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `analytic`."""
    return RepresentationSpec(
        name="analytic",
        summary="a solid given by a formula: CSG tree in TOML or JSON, or module:callable",
        config=AnalyticConfig,
        open="ndf_plugin_sdf.analytic_surface:open_analytic",
        api_version=API_VERSION,
        support="full",
        training_defaults=COSTLY_TRAINING_DEFAULTS,
        suffixes=(".toml", ".json"),
        sniff=sniff,
    )


def names_callable(source: str | Path) -> bool:
    """Whether this is ``module:callable`` or ``file.py:callable``, and not a file."""
    return bool(_CALLABLE.fullmatch(str(source))) and not Path(source).exists()


def sniff(path: Path) -> Sniff | None:
    """A table with a `type` at its top is a CSG tree; ``module:callable`` can be a field."""
    if names_callable(path):
        return Sniff(0.6, "the name of a function, phi(points)")
    if path.suffix.lower() not in (".toml", ".json") or not path.is_file():
        return None
    document = _document(path)
    if isinstance(document, dict) and "type" in document:
        return Sniff(1.0, f"CSG tree with a {document['type']!r:.40} at its top")
    return Sniff(0.3, f"only by its suffix, {path.suffix}")


def _document(path: Path) -> Any:
    """The content; None where it is none."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            return None
        text = path.read_text("utf-8")
        return json.loads(text) if path.suffix.lower() == ".json" else tomllib.loads(text)
    except (OSError, ValueError, RecursionError):
        return None
