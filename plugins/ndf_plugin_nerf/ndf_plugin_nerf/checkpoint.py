"""Named arrays from PyTorch checkpoints, loaded weights-only: no code of the file runs."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import InputError

MOST_BYTES = 256 << 20
"""Of a checkpoint, packed or not; that of a vanilla NeRF takes two megabytes to forty."""
_DEEPEST = 8


def read_checkpoint(path: Path) -> dict[str, Array]:
    """Every tensor of numbers in the checkpoint, float32, by its names joined with dots; nothing else of it.

    Raises:
        InputError: the file is too large, cut off, no checkpoint, or one that needs code to be read.
    """
    if path.stat().st_size > MOST_BYTES or _unpacked(path) > MOST_BYTES:
        raise InputError(f"{path}: larger than {MOST_BYTES >> 20} MiB, which no vanilla NeRF is")
    try:
        content: Any = torch.load(path, map_location="cpu", weights_only=True)
    except MemoryError as error:
        raise InputError(
            f"{path}: it says that it needs more memory than there is; is it cut off or corrupted?"
        ) from error
    except Exception as error:  # what torch raises for a bad file has no common base
        text = " ".join(str(error).split())
        if "weights_only" in text.lower() or "unsupported global" in text.lower():
            raise InputError(
                f"{path}: it holds objects that only code could restore, and code of a file is never run. Where you "
                "trust it, save the tensors alone: torch.save(model.state_dict(), path)"
            ) from error
        raise InputError(
            f"{path}: is no readable PyTorch checkpoint ({type(error).__name__}: {text[:160]})"
        ) from error
    arrays: dict[str, Array] = {}
    _collect(content, "", arrays, 0)
    return arrays


def _unpacked(path: Path) -> int:
    """Bytes of a zip archive's members; 0 where it is none (the format before torch 1.6)."""
    try:
        with zipfile.ZipFile(path) as archive:
            return sum(member.file_size for member in archive.infolist())
    except (zipfile.BadZipFile, NotImplementedError, OSError, ValueError):
        return 0


def _collect(value: Any, name: str, arrays: dict[str, Array], depth: int) -> None:
    if isinstance(value, Tensor):
        if value.is_floating_point() and value.layout == torch.strided:
            arrays[name] = np.ascontiguousarray(value.detach().to(torch.float32).numpy())
    elif isinstance(value, Mapping) and depth < _DEEPEST:
        for key, item in value.items():
            if isinstance(key, str):
                _collect(item, f"{name}.{key}" if name else key, arrays, depth + 1)
