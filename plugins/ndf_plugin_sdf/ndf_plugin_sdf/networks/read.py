"""Named arrays of numbers from files of weights. Nothing here runs code from a file, and every size is bounded."""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.readers.numpy_arrays import read_npz
from ndf_plugin_sdf.networks.formats import look
from ndf_plugin_sdf.networks.hdf5 import read_hdf5

MOST_BYTES = 512 << 20
"""Of a file, and of its arrays unpacked."""
_MOST_ARRAYS = 4096
_MOST_NESTING = 16


def read_arrays(path: Path) -> dict[str, Array]:
    """The arrays of a weight file by name, in the file's order.

    Raises:
        InputError: the file is of no known kind, broken, too large, or would have to be unpickled.
    """
    try:
        size = path.stat().st_size
        found = look(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    if size > MOST_BYTES:
        raise InputError(f"{path}: {size} bytes are more than the {MOST_BYTES} that weights may take")
    if found is None:
        raise InputError(f"{path}: no weights of a network: neither .npz, .safetensors, .h5 nor a torch checkpoint")
    match found.format:
        case "npz":
            return read_npz(path, MOST_BYTES)
        case "hdf5":
            return read_hdf5(path, MOST_BYTES)
        case "safetensors":
            return _safetensors(path)
        case "checkpoint":
            return _checkpoint(path)
        case "program":
            raise InputError(f"{path}: an exported program, not weights")  # opened elsewhere


def _safetensors(path: Path) -> dict[str, Array]:
    import safetensors
    from safetensors.torch import load_file

    try:
        return _as_arrays(load_file(path), str(path))
    except (safetensors.SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: {error}") from error


def _checkpoint(path: Path) -> dict[str, Array]:
    """A torch checkpoint: nested dictionaries become names with dots."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked > MOST_BYTES:
            raise InputError(f"{path}: unpacks to {unpacked} bytes, more than the {MOST_BYTES} allowed")
    try:
        content: Any = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise InputError(
            f"{path}: holds more than weights, which could run code; save its state_dict() alone, "
            f"best as .safetensors ({_one_line(error)})"
        ) from error
    except Exception as error:  # torch raises all kinds for broken files
        raise InputError(f"{path}: broken checkpoint: {_one_line(error)}") from error
    return _as_arrays(dict(_flat(content, "", _MOST_NESTING)), str(path))


def _flat(content: Any, prefix: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Tensors anywhere in nested dictionaries, with their path as name. Optimizer states are left out."""
    if isinstance(content, (Tensor, np.ndarray)):
        yield prefix.removesuffix("."), content
    elif isinstance(content, Mapping) and depth:
        for key, value in content.items():
            if not str(key).startswith("optim"):
                yield from _flat(value, f"{prefix}{key}.", depth - 1)


def _as_arrays(tensors: Mapping[str, Any], origin: str) -> dict[str, Array]:
    """Real numbers as numpy arrays.

    Raises:
        InputError: too many of them, or too large: strides can make a small storage a huge tensor.
    """
    if len(tensors) > _MOST_ARRAYS:
        raise InputError(f"{origin}: holds {len(tensors)} arrays, more than the {_MOST_ARRAYS} allowed")
    if sum(tensor.nbytes for tensor in tensors.values()) > MOST_BYTES:
        raise InputError(f"{origin}: its arrays take more than the {MOST_BYTES} bytes allowed")
    arrays: dict[str, Array] = {}
    for name, tensor in tensors.items():
        if isinstance(tensor, Tensor):
            if not tensor.is_floating_point() or tensor.is_quantized or tensor.layout is not torch.strided:
                continue
            arrays[name] = tensor.detach().to(torch.float64).numpy()
        elif tensor.dtype.kind == "f":
            arrays[name] = tensor
    return arrays


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200]
