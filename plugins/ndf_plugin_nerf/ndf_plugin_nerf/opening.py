"""Opening `nerf`: weights, a grid or a function become a density, and the density a surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_plugin_nerf.grid_extractor import GridExtractor, smoothed
from ndf_plugin_nerf.isosurface import isosurface, sample_triangles
from ndf_plugin_nerf.nerf import TRAINING_DEFAULTS, NerfConfig
from ndf_plugin_nerf.outer_field import OuterField
from ndf_plugin_nerf.ray_projector import RayProjector
from ndf_plugin_nerf.region import find_region
from ndf_plugin_nerf.source import read_density
from ndf_plugin_nerf.tsdf import fused


def open_nerf(source: str | Path | object, config: NerfConfig) -> Surface:
    """Open the density of a NeRF: weights (.npz, checkpoint), a grid (.npz, .npy), a function (named or itself).

    Raises:
        InputError: it cannot be read, or there is no closed object in it.
    """
    read = read_density(source, config)
    crop = None if config.crop is None else Box(np.array(config.crop[:3]), np.array(config.crop[3:]))
    try:
        region = find_region(read.density, crop, config.threshold, config.min_part)
    except InputError as error:
        raise InputError(f"{read.name}: {error}") from error
    field = OuterField.of(read.density, region.box, region.threshold, config.resolution, config.min_part)
    if not field.inside.any():
        raise InputError(f"{read.name}: nothing solid is left at --resolution {config.resolution}")
    make_grid = fused if config.base_mesh == "tsdf" else smoothed
    reach = config.reach * region.box.longest_side
    share = 100 * field.asked / field.nodes.total
    notes = (
        *read.notes,
        *region.notes,
        f"density at {field.asked:,} points ({share:.0f}% of a grid of {' x '.join(map(str, field.nodes.counts))})",
    )
    return Surface(
        representation="nerf",
        base_mesh=GridExtractor(lambda: make_grid(field), field.remarks),
        projector=RayProjector(read.density, field, reach),
        fingerprint=fingerprint("nerf", config, read.content),
        training_defaults=TRAINING_DEFAULTS,
        sample=lambda count, rng: sample_triangles(isosurface(field.nodes, field.values), count, rng),
        notes=notes,
    )
