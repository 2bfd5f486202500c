"""``--repr oriented-points``: points with outward normals, read through their generalised winding number."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_plugin_pointcloud.defaults import API_VERSION, POINT_SUFFIXES, WINDING_DEFAULTS
from ndf_plugin_pointcloud.detect import look


class OrientedPointsConfig(BaseModel):
    """Options of `oriented-points`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    smoothing: float | None = Field(
        None,
        ge=0.25,
        le=20,
        allow_inf_nan=False,
        description="radius over which each point's normal is spread, in radii of the disc that it stands for: more "
        "for noisy points, less for fine detail; none: 1 to 2 by how far neighbours scatter",
    )
    denoise: bool = Field(
        True,
        description="move points that scatter about their neighbours onto quadrics through those that face the same "
        "way, before their normals are spread",
    )
    resolution: int | None = Field(
        None,
        ge=16,
        le=1024,
        description="most cells of the base mesh's grid along the longest side; none: 256, more where the surface "
        "has little area for its size",
    )


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `oriented-points`."""
    return RepresentationSpec(
        name="oriented-points",
        summary="points with outward normals; their surface is where the winding number is one half",
        config=OrientedPointsConfig,
        open="ndf_plugin_pointcloud.oriented_surface:open_oriented_points",
        api_version=API_VERSION,
        support="full",
        training_defaults=WINDING_DEFAULTS,
        suffixes=POINT_SUFFIXES,
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """A file of points with normals."""
    if not path.is_file():
        return None
    content = look(path)
    return Sniff(0.6, f"points with normals ({content.format})") if content and content.normals else None
