"""PlayCanvas' SOG: attributes as pixels of lossless pictures, described by a meta.json; zipped, or as a folder.

Version 1 has linear ranges for scales and colours where version 2 has code books.

Reference: https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/
"""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from PIL import Image

from ndf_plugin_gaussians.readers.limits import MOST_BYTES, MOST_PIXELS, check_count
from ndf_plugin_gaussians.readers.smallest_three import from_smallest_three
from ndf_plugin_gaussians.splats import SH_C0, Splats, make_splats, sigmoid

_MOST_META = 16 << 20
_FORMATS = ("WEBP", "PNG")
"""Lossless pictures of eight bits; the specification allows others than WebP."""
_SPARE = 16
"""Pictures may have so many times the pixels that the splats need, and 65,536 more."""

Open = Callable[[str, int], bytes]
"""``open(name, most_bytes)``: the content of a file of the set."""


def read_sog(path: Path) -> tuple[Splats, int]:
    """Splats, and the number of those left out as not finite.

    Raises:
        ValueError: the archive, its description or a picture is damaged, missing or too large.
    """
    if path.is_dir():
        return _read(lambda name, most: _from_folder(path, name, most))
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(lambda name, most: _from_archive(archive, name, most))
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error, struct.error) as error:
        raise ValueError(f"the archive is damaged ({error})") from error


def _from_folder(folder: Path, name: str, most: int) -> bytes:
    path = folder / name
    if not path.is_file():
        raise ValueError(f"there is no {name} in the folder")
    if path.stat().st_size > most:
        raise ValueError(f"{name} is larger than {most:,} bytes")
    return path.read_bytes()


def _from_archive(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """A file of the archive, at its top or in its only folder; unpacked to `most` bytes and no further."""
    found = [info for info in archive.infolist() if info.filename.rpartition("/")[2] == name]
    if len(found) != 1:
        raise ValueError(f"there is no {name} in the archive" if not found else f"{name} is {len(found)} times in it")
    with archive.open(found[0]) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"{name} unpacks to more than {most:,} bytes")
    return data


def _read(read: Open) -> tuple[Splats, int]:
    try:
        meta = json.loads(read("meta.json", _MOST_META))
        version = meta.get("version", 1)
        count = int(meta["count"] if version == 2 else meta["means"]["shape"][0])
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"its meta.json is no JSON ({error})") from error
    except (KeyError, TypeError, AttributeError, IndexError, OverflowError) as error:
        raise ValueError("its meta.json does not say how many splats there are") from error
    if version not in (1, 2):
        raise ValueError(f"version {version!r:.20} of the format is not known here (1 and 2 are)")
    check_count(count)

    def pixels(key: str, channels: int, which: int = 0) -> UInt8[Array, "n k"]:
        return _picture(read, _file_name(meta, key, which), count, channels)

    low, high = pixels("means", 3, 0), pixels("means", 3, 1)
    logs = _ranged(meta, "means", (low + 256.0 * high) / 65535.0)
    quats, scale, colour = pixels("quats", 4), pixels("scales", 3), pixels("sh0", 4)
    largest = quats[:, 3].astype(np.int64) - 252
    # A tag below 252 is not valid; such a rotation is left out, as players do.
    rotations = from_smallest_three((quats[:, :3] / 255.0 * 2.0 - 1.0) * np.sqrt(0.5), np.maximum(largest, 0))
    rotations[largest < 0] = [1.0, 0.0, 0.0, 0.0]
    if version == 2:
        log_scales, harmonics = _coded(meta, "scales", scale), _coded(meta, "sh0", colour[:, :3])
        opacities = colour[:, 3] / 255.0
    else:
        log_scales, ranged = _ranged(meta, "scales", scale / 255.0), _ranged(meta, "sh0", colour / 255.0)
        harmonics, opacities = ranged[:, :3], sigmoid(ranged[:, 3])
    with np.errstate(over="ignore"):
        centres = np.sign(logs) * np.expm1(np.abs(logs))
    return make_splats(centres, log_scales, rotations, opacities, 0.5 + SH_C0 * harmonics)


def _file_name(meta: dict[str, Any], key: str, which: int) -> str:
    """The name that meta.json gives. It must be a plain name: a path could lead out of the folder."""
    try:
        name = meta[key]["files"][which]
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError(f"its meta.json names no file {which} for {key!r}") from error
    if not isinstance(name, str) or not name or name in (".", "..") or set(name) & set("/\\:\0"):
        raise ValueError(f"its meta.json names {name!r:.60}, which is no plain file name")
    return name


def _numbers(meta: dict[str, Any], key: str, name: str, least: int) -> Float[Array, " k"]:
    try:
        values = np.asarray(meta[key][name], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"its meta.json has no numbers {key}.{name}") from error
    if values.ndim != 1 or len(values) < least:
        raise ValueError(f"its meta.json needs {least} numbers in {key}.{name}")
    return values


def _ranged(meta: dict[str, Any], key: str, share: Float[Array, "n k"]) -> Float[Array, "n k"]:
    low, high = (_numbers(meta, key, end, share.shape[1])[: share.shape[1]] for end in ("mins", "maxs"))
    return low + (high - low) * share


def _coded(meta: dict[str, Any], key: str, index: UInt8[Array, "n k"]) -> Float[Array, "n k"]:
    return _numbers(meta, key, "codebook", 256)[index]


def _picture(read: Open, name: str, count: int, channels: int) -> UInt8[Array, "n k"]:
    """The first `count` pixels, row by row. Their number is looked at before anything is decoded."""
    most = min(MOST_PIXELS, _SPARE * count + 65_536)
    data = read(name, min(MOST_BYTES, 8 * most + (1 << 20)))
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            size = image.width * image.height
            if not count <= size <= most:
                raise ValueError(f"{name} has {size:,} pixels for {count:,} splats")
            return np.asarray(image.convert("RGBA")).reshape(-1, 4)[:count, :channels]
    except (OSError, SyntaxError, Image.DecompressionBombError, EOFError) as error:
        raise ValueError(f"the picture {name} cannot be decoded ({error})") from error
