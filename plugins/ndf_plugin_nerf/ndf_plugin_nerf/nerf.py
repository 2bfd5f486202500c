"""``--repr nerf``: the density of a neural radiance field."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_plugin_nerf.detect import look

TRAINING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Table 3. A projection asks the density about ten times, some ten times the cost of a training step."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Corner = tuple[Finite, Finite, Finite]


class NerfConfig(BaseModel):
    """Options of `nerf`. Lengths are in the input's units, densities per unit of length."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    threshold: float | None = Field(
        None,
        gt=0,
        allow_inf_nan=False,
        description="density of the surface; without it: what 95% of the matter exceeds, but no fog",
    )
    crop: tuple[Finite, Finite, Finite, Finite, Finite, Finite] | None = Field(
        None,
        description="box x0,y0,z0,x1,y1,z1 that holds the object; what it cuts is closed with flat caps. Without it "
        "a background that runs through the sides of the bounds is looked for and cut off",
    )
    bounds: tuple[Corner, Corner] | None = Field(
        None,
        description="box that the density lives in: [[x, y, z], [x, y, z]]. A grid without one of its own and a "
        "function without an attribute `bounds` need it; networks: [[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]]",
    )
    min_part: float = Field(
        0.05,
        ge=0,
        le=1,
        description="separate parts with a smaller share of the largest one's volume are floaters and left out",
    )
    base_mesh: Literal["outer", "tsdf"] = Field(
        "outer",
        description="base mesh from the outer level set of the density, or from depth maps of virtual cameras around "
        "it, fused into a truncated signed distance",
    )
    resolution: int = Field(256, ge=16, le=512, description="cells of the density's grid along the longest side")
    reach: float = Field(
        0.03,
        gt=0,
        le=1,
        description="how far along the mapped normal a projection looks, as a share of the longest side",
    )
    prefix: str | None = Field(
        None, description="take the network whose arrays' names begin so, where a file holds several"
    )

    @model_validator(mode="after")
    def _are_boxes(self) -> NerfConfig:
        corners = {"bounds": self.bounds, "crop": self.crop and (self.crop[:3], self.crop[3:])}
        for name, box in corners.items():
            if box is not None and not all(low < high for low, high in zip(*box, strict=True)):
                raise ValueError(f"{name}: each coordinate of the first corner must be below that of the second")
        return self


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `nerf`."""
    return RepresentationSpec(
        name="nerf",
        summary="the density of a NeRF: network weights, a grid, or module:callable",
        config=NerfConfig,
        open="ndf_plugin_nerf.opening:open_nerf",
        api_version=1,
        support="partial",
        training_defaults=TRAINING_DEFAULTS,
        suffixes=(".npz", ".ckpt", ".pt", ".pth", ".tar"),
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """Arrays with the names of a NeRF's density network, or a named density with its bounds; nothing else."""
    found = look(path)
    return None if found is None else Sniff(1.0, found)
