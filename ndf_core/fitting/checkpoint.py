"""Checkpoints: one safetensors file beside the output, replaced atomically."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from ndf_core.errors import ResumeError
from ndf_core.files import atomic_write

_FORMAT = "ndf-checkpoint-1"
_LARGEST = 4 * 2**30


def checkpoint_path(output: Path) -> Path:
    """Where the checkpoint of a run that writes `output` lies."""
    return output.with_name(output.name + ".checkpoint")


def write_checkpoint(path: Path, tensors: dict[str, Tensor], identity: dict[str, Any]) -> None:
    """Write tensors and the run's identity (config and input fingerprint); a kill leaves the old file or the new."""
    held = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {"format": _FORMAT, "identity": json.dumps(identity, sort_keys=True)}
    with atomic_write(path) as file:
        file.write(save_tensors(held, metadata))


def read_checkpoint(path: Path, identity: dict[str, Any]) -> dict[str, Tensor]:
    """Tensors of the checkpoint at `path`, which must be of the same run.

    Raises:
        ResumeError: the file cannot be read, or is of another input or other options (it says which).
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise ResumeError(f"{path}: too large for a checkpoint; remove it and start again")
        data = path.read_bytes()
        tensors = load_tensors(data)
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
        found = json.loads(header["identity"]) if header["format"] == _FORMAT else None
    except OSError as error:
        raise ResumeError(
            f"{path}: the checkpoint cannot be read ({error.strerror}); start without --resume"
        ) from None
    except (SafetensorError, ValueError, KeyError, TypeError):
        raise ResumeError(f"{path}: not a checkpoint of ndf; remove it and start without --resume") from None
    if found != identity:
        raise ResumeError(
            f"{path}: belongs to another run ({_differences(found, identity)}); "
            "give the same input and options, or start without --resume"
        )
    return tensors


def _differences(found: Any, wanted: dict[str, Any]) -> str:
    if not isinstance(found, dict):
        return "another format"
    keys = sorted(key for key in {*found, *wanted} if found.get(key) != wanted.get(key))
    return ", ".join(f"{key} was {found.get(key)!r}, is {wanted.get(key)!r}" for key in keys[:4])
