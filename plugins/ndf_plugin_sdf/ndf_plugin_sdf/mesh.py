"""``--repr mesh``: a closed triangle mesh read as a signed distance field."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_core.readers.closedness import is_closed
from ndf_core.readers.detect import SUFFIXES, look
from ndf_plugin_sdf.defaults import API_VERSION, TRAINING_DEFAULTS


class MeshConfig(BaseModel):
    """Options of `mesh`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    base_mesh: Literal["auto", "decimate", "marching_cubes"] = Field(
        "auto", description="how the base mesh is made: from the mesh itself, or from its signed distance"
    )
    resolution: int = Field(
        256, ge=16, le=1024, description="cells of the marching-cubes grid along the longest side"
    )
    merge_tolerance: float | None = Field(
        None,
        ge=0,
        le=1e-3,
        allow_inf_nan=False,
        description="vertices at most this far apart become one, as a share of the longest side; 0: only equal ones; "
        "none: 1e-6 where equal ones are not enough to close the mesh",
    )


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `mesh`."""
    return RepresentationSpec(
        name="mesh",
        summary="a closed triangle mesh, read as a signed distance field",
        config=MeshConfig,
        open="ndf_plugin_sdf.mesh_surface:open_mesh",
        api_version=API_VERSION,
        support="full",
        training_defaults=TRAINING_DEFAULTS,
        suffixes=SUFFIXES,
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """A file with triangles that close up, whatever it is called; nothing where it says that it has none.

    Those that do not are left to `soup`, which asks the same `is_closed`.
    """
    if not path.is_file():
        return None
    content = look(path)
    if content.format is None:
        return Sniff(0.3, f"only by its suffix, {path.suffix}") if path.suffix.lower() in SUFFIXES else None
    if not content.has_faces:
        return None
    kind = f"triangle mesh ({content.format.upper()})"
    return Sniff(0.3, f"{kind}, not closed") if is_closed(path) is False else Sniff(0.6, kind)
