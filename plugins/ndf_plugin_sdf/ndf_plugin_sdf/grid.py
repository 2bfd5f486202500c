"""``--repr grid``: the level set of a scalar volume."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_plugin_sdf.defaults import API_VERSION, VOLUME_TRAINING_DEFAULTS
from ndf_plugin_sdf.volumes.formats import SUFFIXES, look

Finite = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class GridConfig(BaseModel):
    """Options of `grid`. Lengths are in the units of the volume's frame."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    iso: Finite | None = Field(
        None,
        description="value at the surface; none: 0 for signed distances, else Otsu's threshold, which is reported",
    )
    inside: Literal["auto", "above", "below"] = Field(
        "auto",
        description="side of the iso value that is inside; auto: above, unless most of the volume's border is above",
    )
    interpolation: Literal["b_spline", "catmull_rom", "linear"] = Field(
        "b_spline", description="between voxels; all three go through their values"
    )
    smallest_part: float = Field(
        0.05,
        ge=0,
        le=1,
        description="bodies with less than this share of the largest body's voxels are left out, cavities with less "
        "are filled; 0 keeps all, 1 the largest alone",
    )
    array: str | None = Field(None, description="name of the volume in a .npz file that has several")
    spacing: tuple[Length, Length, Length] | None = Field(
        None, description="distances of neighbouring voxels along the axes; none: as in the header, or 1"
    )
    origin: tuple[Finite, Finite, Finite] | None = Field(
        None, description="position of the first voxel; none: as in the header, or 0"
    )
    resolution: int | None = Field(
        None, ge=16, le=1024, description="cells of the base mesh's grid along the longest side; none: one per voxel"
    )
    corrections: int = Field(2, ge=0, le=20, description="most steps from a projection towards the closest point")


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `grid`."""
    return RepresentationSpec(
        name="grid",
        summary="a scalar volume and an iso value: .nii .nii.gz .mrc .map .npy .npz",
        config=GridConfig,
        open="ndf_plugin_sdf.grid_surface:open_grid",
        api_version=API_VERSION,
        support="full",
        training_defaults=VOLUME_TRAINING_DEFAULTS,
        suffixes=SUFFIXES,
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """A header that can be nothing else, or an array with three sides."""
    if not path.is_file():
        return None
    found = look(path)
    if found is None:
        suffix = next((suffix for suffix in SUFFIXES if path.name.lower().endswith(suffix)), None)
        return Sniff(0.3, f"only by its suffix, {suffix}") if suffix not in (None, ".npz") else None
    if found.format in ("nifti", "mrc"):
        return Sniff(1.0, f"volume ({found.format.upper()}), {_sides(found.shape)}")
    if found.fault is not None:
        return Sniff(0.3, f"an array, but {found.fault}")
    return Sniff(0.6, f"volume ({found.format}), {_sides(found.shape)}")


def _sides(shape: tuple[int, ...] | None) -> str:
    return "x".join(map(str, shape)) if shape else "several"
