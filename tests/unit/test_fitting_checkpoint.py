"""Checkpoints: what comes back, and what is refused with what words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from small_surfaces import GivenMesh, sphere_mesh
from torch import Tensor

from ndf_core.base_mesh.quantise import encode_base_mesh
from ndf_core.errors import OutputError, ResumeError
from ndf_core.fitting.checkpoint import (
    base_mesh_of,
    base_mesh_tensors,
    checkpoint_path,
    read_checkpoint,
    write_checkpoint,
)
from ndf_core.interfaces import Remark

IDENTITY: dict[str, Any] = {"steps": 100, "loss": {"cycle": 1e2, "normal": 0.0}, "input": "ab" * 32, "anchors": None}


def tensors() -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(0)
    return {
        "parameters": torch.randn(1000, generator=generator),
        "counts": torch.tensor([3, 2**40, 1]),
        "base.blob": torch.arange(256, dtype=torch.uint8),
        "base.scale": torch.tensor(1 / 3, dtype=torch.float64),
        "empty": torch.zeros(0, 4),
    }


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = checkpoint_path(tmp_path / "a.ndf")
    write_checkpoint(file, tensors(), IDENTITY)
    return file


def test_lies_beside_the_output() -> None:
    assert checkpoint_path(Path("folder/a.b.ndf")) == Path("folder/a.b.ndf.checkpoint")


def test_round_trip(path: Path) -> None:
    found = read_checkpoint(path, json.loads(json.dumps(IDENTITY)))
    assert found.keys() == tensors().keys()
    for name, tensor in tensors().items():
        assert found[name].dtype == tensor.dtype and torch.equal(found[name], tensor)
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_view_is_stored_as_it_looks(tmp_path: Path) -> None:
    wide = torch.arange(12.0).view(3, 4)
    write_checkpoint(tmp_path / "c", {"transposed": wide.t(), "row": wide[1]}, IDENTITY)
    found = read_checkpoint(tmp_path / "c", IDENTITY)
    assert torch.equal(found["transposed"], wide.t()) and torch.equal(found["row"], wide[1])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"steps": 200}, "steps was 100, is 200"),
        ({"loss": {"cycle": 3.0, "normal": 0.0}}, r"loss\.cycle was 100\.0, is 3\.0"),
        ({"input": "cd" * 32}, "input was 'abab"),
        ({"anchors": "12"}, "anchors was None, is '12'"),
        ({"new_option": 4}, "new_option was None, is 4"),
    ],
)
def test_of_another_run(path: Path, change: dict[str, Any], words: str) -> None:
    with pytest.raises(ResumeError, match=rf"belongs to another run \({words}.*give the same input and options, or"):
        read_checkpoint(path, IDENTITY | change)


def test_every_flipped_bit_is_noticed(path: Path) -> None:
    good = path.read_bytes()
    for at in [*range(16), *range(16, len(good), 37), len(good) - 1]:
        data = bytearray(good)
        data[at] ^= 4
        path.write_bytes(data)
        with pytest.raises(ResumeError, match="a.ndf.checkpoint: "):
            read_checkpoint(path, IDENTITY)


@pytest.mark.parametrize("length", [0, 1, 7, 8, 100, 2000, -1])
def test_truncated(path: Path, length: int) -> None:
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(ResumeError, match="not a checkpoint of ndf; remove it and start without --resume"):
        read_checkpoint(path, IDENTITY)


@pytest.mark.parametrize("content", [b"\xff" * 500, b"solid thing\n" * 50, b"\x80" + b"\x00" * 7 + b"{" * 128])
def test_some_other_file(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(ResumeError, match="not a checkpoint of ndf"):
        read_checkpoint(path, IDENTITY)


@pytest.mark.parametrize(
    "metadata", [None, {}, {"format": "ndf-checkpoint-9", "identity": "{}"}, {"format": "ndf-checkpoint-2"}]
)
def test_other_tensors(path: Path, metadata: dict[str, str] | None) -> None:
    save_file({"weights": torch.ones(3)}, path, metadata)
    with pytest.raises(ResumeError, match="not a checkpoint of ndf|another run"):
        read_checkpoint(path, IDENTITY)


def test_what_cannot_be_read(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ResumeError, match=r"cannot be read \(Is a directory\); start without --resume"):
        read_checkpoint(path.parent, IDENTITY)
    monkeypatch.setattr("ndf_core.fitting.checkpoint._LARGEST", 10)
    with pytest.raises(ResumeError, match="too large for a checkpoint"):
        read_checkpoint(path, IDENTITY)


def test_a_failed_write_leaves_the_old_one(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And nothing beside it."""
    before = path.read_bytes()

    def full(held: dict[str, Tensor], metadata: dict[str, str]) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ndf_core.fitting.checkpoint.save_tensors", full)
    with pytest.raises(OSError, match="No space"):
        write_checkpoint(path, tensors(), IDENTITY)
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_checkpoint(tmp_path / "missing" / "c", tensors(), IDENTITY)


def test_base_mesh_comes_back_bit_for_bit(tmp_path: Path) -> None:
    base = encode_base_mesh(GivenMesh(sphere_mesh()).extract(100))
    remarks = (Remark("crumb", "gone: \u00e9", (0.1, 1 / 3, -2e-7), 1e-9, 3), Remark("plain", "nothing known"))
    write_checkpoint(tmp_path / "c", base_mesh_tensors(base, remarks), IDENTITY)
    found, told = base_mesh_of(read_checkpoint(tmp_path / "c", IDENTITY))
    assert told == remarks
    assert (found.blob, found.scale, found.bits) == (base.blob, base.scale, base.bits)
    for one, two in ((found.vertices, base.vertices), (found.faces, base.faces), (found.center, base.center)):
        assert one.dtype == two.dtype
        np.testing.assert_array_equal(one, two)
