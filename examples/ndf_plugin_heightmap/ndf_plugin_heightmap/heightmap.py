"""``--repr heightmap``. Imported to look at files and for help texts: nothing heavy here, no numpy, no torch."""

from __future__ import annotations

from pathlib import Path

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from pydantic import BaseModel, ConfigDict, Field


class Config(BaseModel):
    """Options of `heightmap`: each is an option of ``ndf fit --repr heightmap``. Lengths are in the file's units."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    depth: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="of the solid below the lowest height; none: a tenth of the longer side",
    )


def sniff(path: Path) -> Sniff | None:
    """An ESRI ASCII grid begins with the word ncols."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        begins = file.read(64).lstrip().lower().startswith(b"ncols")
    return Sniff(1.0, "heightmap (ESRI ASCII grid)") if begins else None


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `heightmap`."""
    return RepresentationSpec(
        name="heightmap",
        summary="a terrain over a flat base: ESRI ASCII grid",
        config=Config,
        open="ndf_plugin_heightmap.opening:open_heightmap",
        api_version=1,
        support="full",
        training_defaults={"loss": {"cycle": 1e2, "projection": 1e4}},
        suffixes=(".asc",),
        sniff=sniff,
    )
