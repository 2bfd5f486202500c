"""NIfTI files, read by nibabel once the header is known to be harmless."""

from __future__ import annotations

import gzip
import zlib
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
from jaxtyping import Float
from nibabel.filebasedimages import ImageFileError
from nibabel.spatialimages import HeaderDataError
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_plugin_sdf.volumes.nifti_header import read_nifti_header
from ndf_plugin_sdf.volumes.volume import MOST_VOXELS


def read_nifti(path: Path) -> tuple[Float[Array, "x y z"], Float[Array, "4 4"], tuple[str, ...]]:
    """Voxels with the header's scaling applied, the affine from index to millimetres, and notes.

    Raises:
        InputError: the file is cut off or broken, or has more voxels than allowed.
    """
    header = read_nifti_header(path)
    assert header is not None  # `look` has seen it
    if header.count > MOST_VOXELS:
        raise InputError(f"{path}: {header.shape} are more than the {MOST_VOXELS} voxels allowed; crop or thin it")
    try:
        with path.open("rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            if not packed and path.stat().st_size < header.count * header.voxel_bytes:
                raise InputError(f"{path}: cut off: fewer bytes than its {header.shape} voxels take")
            # The content decides, not the suffix, as nibabel.load would have it.
            with gzip.open(file) if packed else nullcontext(file) as stream:
                kind: Any = nibabel.Nifti2Image if header.version == 2 else nibabel.Nifti1Image
                image = kind.from_stream(stream)
                values = np.asarray(image.dataobj, dtype=np.float32).reshape(header.shape)
    except (ImageFileError, HeaderDataError, OSError, EOFError, zlib.error, ValueError, OverflowError) as error:
        raise InputError(f"{path}: broken or cut off: {' '.join(str(error).split())[:200]}") from error
    return values, np.asarray(image.affine, np.float64), ()
