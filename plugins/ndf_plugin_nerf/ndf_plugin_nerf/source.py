"""From what the user names to a density: weights, a grid, or a function."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.readers.numpy_arrays import read_npy, read_npz
from ndf_core.surfaces.box import Box
from ndf_plugin_nerf.checkpoint import read_checkpoint
from ndf_plugin_nerf.density import Density
from ndf_plugin_nerf.density_network import assemble
from ndf_plugin_nerf.detect import density_and_bounds
from ndf_plugin_nerf.families import FAMILIES, networks, preferred
from ndf_plugin_nerf.function import FunctionDensity, find
from ndf_plugin_nerf.grid import GridDensity
from ndf_plugin_nerf.nerf import NerfConfig

MOST_BYTES = 1 << 30
"""Of a grid: 512^3 numbers in double precision."""
_CALLABLE = re.compile(r"(?:[A-Za-z_][\w.]*|.+\.py):[A-Za-z_][\w.]*")
_UNIT = Box(np.full(3, -1.5), np.full(3, 1.5))
"""Where networks are looked at: the synthetic scenes of NeRF lie in it."""


@dataclass(frozen=True)
class Read:
    """A density, and what is known of where it came from."""

    name: str
    density: Density
    content: list[bytes | str | Array]
    """For the fingerprint."""
    notes: tuple[str, ...]


def read_density(source: str | Path | object, config: NerfConfig) -> Read:
    """Read a file, import what ``module:callable`` names, or take a function.

    Raises:
        InputError: it is none of these, or cannot be read.
    """
    bounds = None if config.bounds is None else Box(np.array(config.bounds[0]), np.array(config.bounds[1]))
    if callable(source):
        return _from_function(getattr(source, "__qualname__", type(source).__name__), source, config, bounds)
    if not isinstance(source, str | Path):
        raise InputError(f"nerf: need a file, module:callable or a function, not {type(source).__name__}")
    path = Path(source)
    if _CALLABLE.fullmatch(str(source)) and not path.exists():
        return _from_function(str(source), find(str(source)), config, bounds)
    if path.is_dir():
        raise InputError(
            f"{path}: is a folder; nerf reads weights (.npz, checkpoints), grids (.npz, .npy) or a function"
        )
    with path.open("rb") as file:
        start = file.read(6)
    if start == b"\x93NUMPY":
        return _from_grid(path, read_npy(path, MOST_BYTES), None, bounds)
    if start.startswith(b"PK") and path.suffix.lower() == ".npz":
        return _from_archive(path, read_npz(path, MOST_BYTES), config, bounds)
    return _from_weights(path, read_checkpoint(path), config, bounds)


def _from_archive(path: Path, arrays: Mapping[str, Array], config: NerfConfig, bounds: Box | None) -> Read:
    found = density_and_bounds({name: array.shape for name, array in arrays.items()})
    if found is not None:
        return _from_grid(path, arrays[found[0]], arrays[found[1]], bounds)
    volumes = [name for name, array in arrays.items() if array.ndim == 3]
    if len(volumes) == 1:
        return _from_grid(path, arrays[volumes[0]], None, bounds)
    return _from_weights(path, arrays, config, bounds)


def _from_weights(path: Path, arrays: Mapping[str, Array], config: NerfConfig, bounds: Box | None) -> Read:
    found = networks(arrays)
    if config.prefix is not None:
        chosen = [one for one in found if one.prefix.startswith(config.prefix)]
    else:
        chosen = preferred(found)
    if len(chosen) != 1:
        known = ", ".join(family.name for family in FAMILIES)
        listed = (
            ", ".join(repr(one.prefix) for one in found) or f"none among {', '.join(list(arrays)[:6]) or 'no arrays'}"
        )
        what = "more than one density network" if chosen else "no density network"
        raise InputError(f"{path}: {what} with the names of {known}; prefixes found: {listed}. Choose with --prefix")
    named = chosen[0]
    network = assemble(arrays, named, bounds or _UNIT)
    notes = [f"network {named.prefix.rstrip('.') or named.family.name}: {network.description}"]
    left = [one.prefix.rstrip(".") for one in found if one is not named]
    if left:
        notes.append(f"not used: {', '.join(left)}")
    content: list[bytes | str | Array] = [named.prefix]
    for layer in network.layers:
        content += [layer.weight.numpy(), layer.bias.numpy()]
    return Read(str(path), network, content, tuple(notes))


def _from_grid(path: Path, values: Array, own: Array | None, bounds: Box | None) -> Read:
    if bounds is None and own is not None:
        corners = own.astype(np.float64).reshape(2, 3)
        if not np.isfinite(corners).all() or not (corners[0] < corners[1]).all():
            raise InputError(f"{path}: its bounds are no box, low corner first: {corners.tolist()}")
        bounds = Box(corners[0], corners[1])
    if bounds is None:
        raise InputError(f"{path}: say where the grid lies, --bounds '[[-1, -1, -1], [1, 1, 1]]' (outermost samples)")
    if values.ndim != 3 or min(values.shape) < 2:
        raise InputError(f"{path}: a density grid has three axes x, y, z of at least 2 samples, not {values.shape}")
    density = GridDensity(values, bounds)
    notes = [f"density grid of {' x '.join(map(str, values.shape))} samples"]
    if density.replaced:
        notes.append(f"{density.replaced:,} samples are not finite and count as empty")
    return Read(str(path), density, [values, bounds.lower, bounds.upper], tuple(notes))


def _from_function(name: str, function: Callable[[Any], Any], config: NerfConfig, bounds: Box | None) -> Read:
    if bounds is None and config.crop is not None:
        bounds = Box(np.array(config.crop[:3]), np.array(config.crop[3:]))
    density = FunctionDensity(name, function, bounds)
    # What the function computes speaks for it: its text may use other modules.
    rng = np.random.default_rng(0)
    box = density.bounds
    points = box.lower + rng.random((4096, 3)) * (box.upper - box.lower)
    return Read(name, density, [points, density.on_arrays(points)], ())
