"""A short look at a file: is it the density of a NeRF? Standard library only, nothing is unpickled."""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from ndf_core.readers.npy_header import NpyHeader, NpyHeaderError, read_npz_headers
from ndf_plugin_nerf.families import networks

DENSITY_NAMES = ("density", "sigma", "densities", "sigmas")
BOUNDS_NAMES = ("bounds", "aabb", "bbox", "bounding_box")
_LOOKED_AT = 256 << 10
"""Bytes of a pickle: the names of tensors come before their numbers."""
_LEGACY = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."
"""How files of torch.save began before torch 1.6."""
_NAME = re.compile(rb"[A-Za-z_][\w.]*\.weight")


def look(path: Path) -> str | None:
    """What the file is, for the user; None where it is no density of a NeRF."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as file:
            start = file.read(16)
        if start.startswith(_LEGACY):
            with path.open("rb") as file:
                return _checkpoint(file.read(_LOOKED_AT))
        if not start.startswith(b"PK\x03\x04"):
            return None
        pickle = _pickle_in(path)
        return _archive(read_npz_headers(path)) if pickle is None else _checkpoint(pickle)
    except (OSError, NpyHeaderError):
        return None


def density_and_bounds(arrays: Mapping[str, tuple[int, ...]]) -> tuple[str, str] | None:
    """Names of a three-dimensional density and of its bounds among arrays, given by their shapes."""
    density = next((name for name in DENSITY_NAMES if len(arrays.get(name, ())) == 3), None)
    bounds = next((name for name in BOUNDS_NAMES if arrays.get(name) in ((2, 3), (6,))), None)
    return None if density is None or bounds is None else (density, bounds)


def _archive(headers: Mapping[str, NpyHeader]) -> str | None:
    shapes = {name: header.shape for name, header in headers.items()}
    grid = density_and_bounds(shapes)
    if grid is not None:
        return f"grid of densities, {grid[0]!r} {' x '.join(map(str, shapes[grid[0]]))}, with its {grid[1]}"
    return _network(name for name, shape in shapes.items() if len(shape) == 2)


def _checkpoint(pickle: bytes) -> str | None:
    return _network({found.group().decode() for found in _NAME.finditer(pickle)})


def _network(names: Iterable[str]) -> str | None:
    found = networks(names)
    return f"density network of a NeRF ({found[0].family.name})" if found else None


def _pickle_in(path: Path) -> bytes | None:
    """The beginning of the pickle in a PyTorch archive; None where the archive is another one."""
    try:
        with zipfile.ZipFile(path) as archive:
            name = next((name for name in archive.namelist() if name.endswith("/data.pkl")), None)
            if name is None:
                return None
            with archive.open(name) as file:
                return file.read(_LOOKED_AT)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError):
        return None
