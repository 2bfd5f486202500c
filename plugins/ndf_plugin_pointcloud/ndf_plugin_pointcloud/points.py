"""``--repr points``: points without normals, such as raw scans."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_plugin_pointcloud.defaults import API_VERSION, POINT_SUFFIXES, POINTS_DEFAULTS
from ndf_plugin_pointcloud.detect import look


class PointsConfig(BaseModel):
    """Options of `points`. Lengths are in the input's units."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    radius: float | None = Field(
        None,
        gt=0,
        allow_inf_nan=False,
        description="of the dilation; none: the smallest that closes around an inside, or twice the spacing of the "
        "points where none does",
    )
    interior: Literal["fill", "keep"] = Field("fill", description="whether a hollow inside is filled")
    open: Literal["auto", "shell", "cap"] = Field(
        "auto",
        description="what becomes of points that close around nothing: a closed shell, or, "
        "with estimated normals, a surface that the winding number caps; auto: the latter where the points close up "
        "but for holes, are a solid too thin to be dilated, or close only with balls wider than 2.5 spacings",
    )
    thickness: float | None = Field(
        None,
        gt=0,
        allow_inf_nan=False,
        description="of a shell; none: the spacing of the points where they lie on a sheet, and as thick as the "
        "dilation (twice its radius) where they lie on none, such as along curves",
    )
    orient: bool = Field(
        False, description="estimate normals and go on as `oriented-points`, which takes more detail from the points"
    )
    neighbours: int | None = Field(
        None,
        ge=4,
        le=200,
        description="points that a piece of the surface is fitted to: more for noise, fewer for detail; none: as "
        "many as the noise asks for that is found",
    )


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `points`."""
    return RepresentationSpec(
        name="points",
        summary="points without normals: raw scans, dilated to a closed surface",
        config=PointsConfig,
        open="ndf_plugin_pointcloud.points_surface:open_points",
        api_version=API_VERSION,
        support="partial",
        training_defaults=POINTS_DEFAULTS,
        suffixes=POINT_SUFFIXES,
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """A file of points without normals."""
    if not path.is_file():
        return None
    content = look(path)
    return Sniff(0.6, f"points without normals ({content.format})") if content and not content.normals else None
