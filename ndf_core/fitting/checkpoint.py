"""Checkpoints: one safetensors file beside the output, replaced atomically."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor

from ndf_core.asset.base_mesh_codec import decode_base_mesh
from ndf_core.asset.placement import Placement
from ndf_core.base_mesh.quantise import EncodedBaseMesh
from ndf_core.errors import ResumeError
from ndf_core.files import atomic_write
from ndf_core.interfaces import Remark

_FORMAT = "ndf-checkpoint-2"
_LARGEST = 4 * 2**30


def checkpoint_path(output: Path) -> Path:
    """Where the checkpoint of a run that writes `output` lies."""
    return output.with_name(output.name + ".checkpoint")


def write_checkpoint(path: Path, tensors: dict[str, Tensor], identity: dict[str, Any]) -> None:
    """Write tensors and the run's identity (config and input fingerprint); a kill leaves the old file or the new."""
    held = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {"format": _FORMAT, "identity": json.dumps(identity, sort_keys=True), "digest": _digest(held)}
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
        damaged = found is not None and header["digest"] != _digest(tensors)
    except OSError as error:
        raise ResumeError(
            f"{path}: the checkpoint cannot be read ({error.strerror}); start without --resume"
        ) from None
    except (SafetensorError, ValueError, KeyError, TypeError):
        raise ResumeError(f"{path}: not a checkpoint of ndf; remove it and start without --resume") from None
    if damaged:
        raise ResumeError(f"{path}: the checkpoint is damaged; remove it and start without --resume")
    if found != identity:
        raise ResumeError(
            f"{path}: belongs to another run ({_differences(found, identity)}); "
            "give the same input and options, or start without --resume"
        )
    return tensors


def base_mesh_tensors(base: EncodedBaseMesh, remarks: tuple[Remark, ...]) -> dict[str, Tensor]:
    """The base mesh as part of a checkpoint: a resumed run need not make it again."""
    told = json.dumps([asdict(remark) for remark in remarks])
    placed = base.placement
    return {
        **({} if placed is None else {"base.placement": torch.from_numpy(placed.codes)}),
        "base.blob": torch.frombuffer(bytearray(base.blob), dtype=torch.uint8),
        "base.counts": torch.tensor([len(base.vertices), len(base.faces), base.bits]),
        "base.center": torch.from_numpy(np.asarray(base.center, dtype=np.float64)),
        "base.scale": torch.tensor(base.scale, dtype=torch.float64),
        "base.remarks": torch.frombuffer(bytearray(told.encode()), dtype=torch.uint8),
    }


def base_mesh_of(tensors: dict[str, Tensor]) -> tuple[EncodedBaseMesh, tuple[Remark, ...]]:
    """What `base_mesh_tensors` was given, bit for bit."""
    vertices, faces, bits = (int(n) for n in tensors["base.counts"])
    blob = tensors["base.blob"].numpy().tobytes()
    points, triangles = decode_base_mesh(blob, vertices, faces)
    center, scale = tensors["base.center"].numpy(), float(tensors["base.scale"])
    remarks: list[Remark] = []
    for told in json.loads(tensors["base.remarks"].numpy().tobytes()):
        position = told.pop("position")
        remarks.append(Remark(**told, position=None if position is None else tuple(position)))
    codes = tensors.get("base.placement")
    placement = None if codes is None else Placement(codes.numpy())
    return EncodedBaseMesh(blob, points, triangles, center, scale, bits, placement), tuple(remarks)


def _digest(tensors: dict[str, Tensor]) -> str:
    """Hash of all names and numbers: safetensors itself notices no flipped bit."""
    total = hashlib.sha256()
    for name in sorted(tensors):
        total.update(name.encode())
        total.update(tensors[name].reshape(-1).view(torch.uint8).numpy().tobytes())
    return total.hexdigest()


def _differences(found: Any, wanted: dict[str, Any]) -> str:
    if not isinstance(found, dict):
        return "another format"
    one, two = _flat(found), _flat(wanted)
    keys = sorted(key for key in {*one, *two} if one.get(key) != two.get(key))
    return ", ".join(f"{key} was {one.get(key)!r}, is {two.get(key)!r}" for key in keys[:4])


def _flat(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested options under their names on the command line: loss.cycle."""
    result: dict[str, Any] = {}
    for key, value in table.items():
        result |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return result
