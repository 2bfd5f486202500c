"""``--repr soup``: any triangles, read through their generalised winding number."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_core.readers.closedness import is_closed
from ndf_core.readers.detect import SUFFIXES, look
from ndf_plugin_pointcloud.defaults import API_VERSION, WINDING_DEFAULTS


class SoupConfig(BaseModel):
    """Options of `soup`. Lengths are in the input's units."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    method: Literal["auto", "winding", "dilation"] = Field(
        "auto",
        description="winding: holes are capped where the winding number is one half; dilation: a closed shell around "
        "the triangles; auto: dilation where most of what is seen from outside is no boundary of the winding number",
    )
    radius: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="of the dilation; none: 1% of the longest side"
    )
    thickness: float | None = Field(
        None,
        gt=0,
        allow_inf_nan=False,
        description="of what is dilated: half of it on either side of all triangles; none: twice the radius",
    )
    interior: Literal["fill", "keep"] = Field("fill", description="whether a hollow inside of a dilation is filled")
    resolution: int | None = Field(
        None,
        ge=16,
        le=1024,
        description="most cells of the base mesh's grid along the longest side; fewer where the surface would "
        "go through more than 650,000 of them; none: 256, more where the surface has little area for its size",
    )


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `soup`."""
    return RepresentationSpec(
        name="soup",
        summary="any triangles: with holes, intersections, flipped parts, edges of many triangles",
        config=SoupConfig,
        open="ndf_plugin_pointcloud.soup_surface:open_soup",
        api_version=API_VERSION,
        support="full",
        training_defaults=WINDING_DEFAULTS,
        suffixes=SUFFIXES,
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """A file with triangles that do not close up; closed ones are left to `mesh`, which asks the same `is_closed`."""
    if not path.is_file():
        return None
    content = look(path)
    if content.format is None or not content.has_faces or is_closed(path) is not False:
        return None
    return Sniff(0.6, f"triangles that do not close up ({content.format.upper()})")
