"""Opening `grid`: a volume becomes a field with its iso value at zero, and the field a surface."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.base_mesh.level_set import LevelSetPolicy
from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_core.surfaces.level_set_surface import level_set_surface
from ndf_plugin_sdf.capped_field import CappedField
from ndf_plugin_sdf.defaults import VOLUME_TRAINING_DEFAULTS
from ndf_plugin_sdf.grid import GridConfig
from ndf_plugin_sdf.grid_field import GridField
from ndf_plugin_sdf.volumes.parts import clear_of_zero, without_small_parts
from ndf_plugin_sdf.volumes.read import framed, read_volume
from ndf_plugin_sdf.volumes.threshold import border_above, chosen_iso
from ndf_plugin_sdf.volumes.volume import Volume

_MARGIN = 6
"""Voxels kept around the inside: the spline's ends are not felt so far away."""
_COARSEST, _FINEST = 96, 320
"""Cells of the base mesh's grid along the longest side."""
_SHORTEST_LOOP = 4.0
"""In cells, of handles that are kept where two resolutions disagree: a tube of one voxel has so long a loop."""
_MOSTLY = 0.75
"""Share of the border above the iso value from which on inside is below: volumes are brighter inside, as a rule."""
_STEEPER = 1.5
"""The field may be so much steeper than at any crossing between voxels."""


def open_grid(source: str | Path | object, config: GridConfig) -> Surface:
    """Open a file with a volume, or an array with three sides.

    Raises:
        InputError: it cannot be read, or has no level set at the iso value.
    """
    if isinstance(source, (str, Path)):
        volume, name = read_volume(Path(source), config), str(source)
    elif isinstance(source, np.ndarray):
        volume, name = framed(source, np.eye(4), (), config, "the array"), "the array"
    else:
        raise InputError(f"grid: need a file, or an array with three sides, not {type(source).__name__}")
    content = [volume.values, volume.matrix, volume.origin]
    try:
        phi, notes = _phi(volume, config)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    field, near, sides = _field(phi, config)
    if sides:
        notes.append(f"the level set reaches the volume's border at {', '.join(sides)} and is closed there, flat")
    extent = float(np.ptp(near, axis=0).max())
    resolution = config.resolution or int(np.clip(np.ceil(extent / phi.spacing.min()), _COARSEST, _FINEST))
    return level_set_surface(
        "grid",
        field,
        resolution=resolution,
        corrections=config.corrections,
        fingerprint=fingerprint("grid", config, content),
        training_defaults=VOLUME_TRAINING_DEFAULTS,
        notes=(*volume.notes, *notes),
        near=near,
        # Between the voxels there is nothing finer to be found.
        policy=LevelSetPolicy(resolution=resolution, max_resolution=resolution, min_loop=_SHORTEST_LOOP),
    )


def _phi(volume: Volume, config: GridConfig) -> tuple[Volume, list[str]]:
    """The part of the volume about the surface, relative to the iso value and negative inside."""
    notes: list[str] = []
    if config.iso is None:
        iso, why = chosen_iso(volume)
        notes.append(why)
    else:
        iso = config.iso
    above = config.inside == "above"
    if config.inside == "auto":
        share = border_above(volume.values, iso)
        above = share <= _MOSTLY
        outer = f"{1 - share if above else share:.0%} of the border is {'below' if above else 'above'} it"
        notes.append(f"inside is {'above' if above else 'below'} the iso value, since {outer}")
    values = volume.values - np.float32(iso)
    values = -values if above else values
    if not (values < 0).any() or not (values > 0).any():
        low, high = float(volume.values.min()), float(volume.values.max())
        raise InputError(
            f"no level set at {iso:.6g}: the values run from {low:.6g} to {high:.6g}; give another --iso"
        )
    values, dropped = without_small_parts(values, config.smallest_part)
    if config.interpolation != "linear":
        values = clear_of_zero(values)
    return replace(volume, values=values).cropped(values < 0, _MARGIN), [*notes, *dropped]


def _field(phi: Volume, config: GridConfig) -> tuple[CappedField, Float[Array, "n 3"], list[str]]:
    """The field, points near its surface, and the sides of the volume where the inside reaches the border."""
    inner = GridField(phi, config.interpolation)
    crossings = _crossings(phi)
    _, gradients = inner.values_and_gradients(torch.from_numpy(crossings))
    slopes = gradients.square().sum(dim=1).sqrt()
    inner.lipschitz = _STEEPER * float(slopes.max())
    normals, offsets = phi.planes()
    margin = float(phi.spacing.max())
    # A cap is as steep as a usual place of the surface, so that neither dwarfs the other at the rim.
    field = CappedField(inner, normals, offsets, float(slopes.median()), _around(phi, margin))
    caps, sides = _inside_on_border(phi)
    return field, np.concatenate([crossings, caps]), sides


def _around(phi: Volume, margin: float) -> Box:
    """The box of the negative voxels, one voxel and a margin wider."""
    tight = phi.cropped(phi.values < 0, 1)
    return Box.around(tight.corners, margin)


def _crossings(phi: Volume) -> Float[Array, "n 3"]:
    """The zeros between neighbouring voxels, by linear interpolation."""
    found: list[Array] = []
    for axis in range(3):
        along = np.moveaxis(phi.values, axis, 0)
        first, second = along[:-1], along[1:]
        place = np.argwhere((first < 0) != (second < 0)).astype(np.float64)
        index = tuple(place.astype(np.int64).T)
        before, after = first[index].astype(np.float64), second[index].astype(np.float64)
        place[:, 0] += before / (before - after)
        found.append(np.insert(place[:, 1:], axis, place[:, 0], axis=1))
    return phi.positions(np.concatenate(found))


def _inside_on_border(phi: Volume) -> tuple[Float[Array, "n 3"], list[str]]:
    """Positions of the negative voxels on the volume's faces, and the names of these faces."""
    found: list[Array] = [np.zeros((0, 3))]
    sides: list[str] = []
    for axis, name in enumerate("ijk"):
        for end, sign in ((0, "-"), (phi.values.shape[axis] - 1, "+")):
            place = np.argwhere(phi.values.take(end, axis) < 0).astype(np.float64)
            if len(place):
                sides.append(f"{sign}{name}")
                found.append(np.insert(place, axis, float(end), axis=1))
    return phi.positions(np.concatenate(found)), sides
