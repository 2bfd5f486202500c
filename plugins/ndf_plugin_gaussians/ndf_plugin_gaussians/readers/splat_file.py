"""Any file of splats to `Splats`."""

from __future__ import annotations

from pathlib import Path

from ndf_core.errors import InputError
from ndf_plugin_gaussians.detect import NAMES, SUFFIXES, Format, look
from ndf_plugin_gaussians.readers.compressed_ply import read_compressed_ply
from ndf_plugin_gaussians.readers.inria_ply import read_inria_ply
from ndf_plugin_gaussians.readers.limits import MOST_BYTES
from ndf_plugin_gaussians.readers.sog import read_sog
from ndf_plugin_gaussians.readers.splat import read_splat
from ndf_plugin_gaussians.readers.spz import read_spz
from ndf_plugin_gaussians.splats import Splats

_READERS = {
    "inria ply": read_inria_ply,
    "compressed ply": read_compressed_ply,
    "splat": read_splat,
    "spz": read_spz,
}
_BY_SUFFIX: dict[str, Format] = {".splat": "splat", ".spz": "spz", ".sog": "sog"}


def read_splat_file(path: Path) -> tuple[Splats, tuple[str, ...]]:
    """Read splats by the file's content, with notes about it; its suffix decides where the content shows nothing.

    Raises:
        InputError: the file cannot be read as splats, or holds none with finite numbers.
    """
    kind: Format | None = None
    try:
        kind = look(path) or _BY_SUFFIX.get(path.suffix.lower())
        if kind is None:
            raise InputError(f"{path}: no file of Gaussian splats; {' '.join(SUFFIXES)} and folders of .sog are read")
        if path.is_file() and path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: larger than {MOST_BYTES >> 30} GiB")
        splats, dropped = _READERS[kind](path.read_bytes()) if kind in _READERS else read_sog(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path}: cannot be read as {NAMES[kind] if kind else 'splats'}: {error}") from error
    if not len(splats):
        raise InputError(f"{path}: none of its {dropped:,} splats has finite numbers")
    notes = [f"{len(splats) + dropped:,} splats read from {NAMES[kind]}"]
    if dropped:
        notes.append(f"{dropped:,} splats with numbers that are not finite were left out")
    return splats, tuple(notes)
