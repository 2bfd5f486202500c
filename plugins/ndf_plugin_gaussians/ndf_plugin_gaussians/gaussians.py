"""``--repr gaussians``: trained 3D Gaussian splats, without cameras or images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_plugin_gaussians.detect import NAMES, SUFFIXES, look

TRAINING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e5, "projection": 1e4}}
"""Table 3, for the paper's projection: closest centres jump, and a strong cycle loss evens that out."""
SMOOTH_TRAINING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e3, "projection": 1e4}, "projection_visits": 4}
"""For the smooth one, which needs less of that. It costs some ten times a training step per point, so each projection
serves for four."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Side = Literal["auto", "none", "-x", "+x", "-y", "+y", "-z", "+z"]


class GaussiansConfig(BaseModel):
    """Options of `gaussians`. Lengths are in the input's units."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    crop: tuple[Finite, Finite, Finite, Finite, Finite, Finite] | None = Field(
        None, description="box x0,y0,z0,x1,y1,z1: splats with their centre outside are left out"
    )
    min_opacity: float = Field(
        0.1, gt=0, lt=1, description="splats fainter than this are left out; others reach to where they become so"
    )
    max_size: float = Field(
        0.15,
        gt=0,
        le=1e6,
        description="splats with a larger standard deviation, as a share of the longest side, are left out",
    )
    far: float = Field(
        0.1,
        ge=0,
        le=1e6,
        description="splats farther than this share of the longest side beyond the middle 99.6% are left out",
    )
    isolation: float = Field(
        10.0,
        gt=1,
        le=1e6,
        description="splats are left out whose neighbours are so many times farther away than the median's, and than "
        "their own size",
    )
    min_component: float = Field(
        0.02, ge=0, le=1, description="components with a smaller share of the largest one's volume are left out"
    )
    resolution: int | None = Field(
        default=None,
        ge=32,
        le=512,
        description="cells along the longest side of the grid that finds the inside (those of the surface are "
        "narrower by a quarter); none: as wide as the centres are apart, 48 to 192",
    )
    base_mesh: Literal["density", "dilation"] = Field(
        "density", description="what is solid: where the splats are opaque, or what is near to a centre"
    )
    stands_on: Side = Field(
        "auto",
        description="side that the object stands on, from where it was not seen: it is closed there with a flat cap; "
        "none: as open as the splats leave it",
    )
    thicken: bool = Field(
        default=True,
        description="give a flat sheet without thickness, such as a floor, some behind the side that was seen",
    )
    projection: Literal["smooth", "centre"] = Field(
        "smooth", description="onto a smooth surface through the visible splats, or onto the closest centre"
    )

    @model_validator(mode="after")
    def _is_box(self) -> GaussiansConfig:
        if self.crop is not None and not all(self.crop[i] < self.crop[i + 3] for i in range(3)):
            raise ValueError("crop: x0, y0, z0 must be below x1, y1, z1")
        return self


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `gaussians`."""
    return RepresentationSpec(
        name="gaussians",
        summary="trained 3D Gaussian splats: the surface that is seen of them, closed",
        config=GaussiansConfig,
        open="ndf_plugin_gaussians.gaussians_surface:open_gaussians",
        api_version=1,
        support="partial",
        training_defaults=TRAINING_DEFAULTS,
        suffixes=SUFFIXES,
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """A file with the columns of splats, or the marks of a splat format."""
    if not (path.is_file() or path.is_dir()):
        return None
    kind = look(path)
    if kind is None:
        suffix = path.suffix.lower()
        return Sniff(0.3, f"only by its suffix, {suffix}") if suffix in (".splat", ".spz", ".sog") else None
    return Sniff(0.6 if kind == "splat" else 1.0, f"Gaussian splats ({NAMES[kind]})")
