"""Volumes from files, with their frame. Every size is checked against the file before anything is allocated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.readers.numpy_arrays import read_npy, read_npz
from ndf_plugin_sdf.grid import GridConfig
from ndf_plugin_sdf.volumes.formats import is_volume, look
from ndf_plugin_sdf.volumes.mrc import read_mrc
from ndf_plugin_sdf.volumes.nifti import read_nifti
from ndf_plugin_sdf.volumes.volume import MOST_VOXELS, Volume

_MOST_BYTES = 8 * MOST_VOXELS


def read_volume(path: Path, config: GridConfig) -> Volume:
    """The volume in a file, in the frame of its header or of the options.

    Raises:
        InputError: it is of no known kind, broken, too large, or holds no volume of finite numbers.
    """
    try:
        found = look(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    if found is None:
        raise InputError(f"{path}: no volume: neither .nii, .mrc, .npy nor .npz with an array of three sides")
    if found.fault is not None:
        raise InputError(f"{path}: {found.fault}")
    match found.format:
        case "nifti":
            values, affine, notes = read_nifti(path)
        case "mrc":
            values, affine, notes = read_mrc(path)
        case "npy":
            values, affine, notes = read_npy(path, _MOST_BYTES), np.eye(4), ()
        case "npz":
            values, affine, notes = _from_archive(path, config.array)
    return framed(values, affine, notes, config, str(path))


def framed(
    values: Array, affine: Float[Array, "4 4"], notes: tuple[str, ...], config: GridConfig, origin: str
) -> Volume:
    """Check the numbers, and let the options move the frame.

    Raises:
        InputError: there are too many voxels, or the frame is none.
    """
    if not is_volume(values.shape) or values.dtype.kind not in "fiub":
        raise InputError(
            f"{origin}: an array {values.shape} of {values.dtype}; need three sides of at least 4, and numbers"
        )
    if values.size > MOST_VOXELS:
        raise InputError(f"{origin}: {values.shape} are more than the {MOST_VOXELS} voxels allowed; crop or thin it")
    values = np.ascontiguousarray(values, np.float32)
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(f"{origin}: no voxel is a finite number")
    if not finite.all():
        # What was not measured is taken to be as empty as the emptiest.
        lowest = float(values[finite].min())
        values = np.where(finite, values, np.float32(lowest))
        notes = (*notes, f"{int((~finite).sum())} voxels are not finite and are taken to be {lowest:.6g}, the least")
    matrix, start = affine[:3, :3].copy(), affine[:3, 3].copy()
    if config.spacing is not None:
        length = np.linalg.norm(matrix, axis=0)
        matrix = matrix * (np.array(config.spacing) / np.where(length > 0, length, 1.0))
    if config.origin is not None:
        start = np.array(config.origin)
    scale = float(np.abs(matrix).max())
    if not (np.isfinite(matrix).all() and np.isfinite(start).all()) or not scale > 0:
        raise InputError(f"{origin}: the frame in its header is not finite; give --spacing and --origin")
    if abs(np.linalg.det(matrix / scale)) < 1e-9:
        raise InputError(f"{origin}: the axes in its header do not span space; give --spacing")
    return Volume(values, matrix, start, notes)


def _from_archive(path: Path, name: str | None) -> tuple[Array, Float[Array, "4 4"], tuple[str, ...]]:
    """The named array, or the only one with three sides; with `affine`, or `spacing` and `origin`, beside it."""
    arrays = read_npz(path, _MOST_BYTES)
    volumes = [key for key, array in arrays.items() if is_volume(array.shape)]
    if name is None and len(volumes) != 1:
        raise InputError(f"{path}: has the volumes {', '.join(volumes) or 'none'}; say which with --array")
    chosen = name if name is not None else volumes[0]
    if chosen not in arrays:
        raise InputError(f"{path}: has no array {chosen!r}; there are {', '.join(list(arrays)[:12])}")
    affine = np.eye(4)
    if "affine" in arrays and arrays["affine"].shape == (4, 4):
        return arrays[chosen], arrays["affine"].astype(np.float64), ()
    for key, place in (("spacing", np.diag_indices(3)), ("origin", (np.arange(3), np.full(3, 3)))):
        if key in arrays and arrays[key].size in (1, 3):
            affine[place] = arrays[key].reshape(-1).astype(np.float64)
    return arrays[chosen], affine, ()
