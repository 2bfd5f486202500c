"""Files that lie: one clear error or a working result, and memory that stays bounded."""

from __future__ import annotations

import pickle
import resource
import struct
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from ndf_plugin_nerf import checkpoint, nerf, source
from nerf_shapes import random_network

import ndf_core
from ndf_core.errors import InputError

MOST_GROWTH = 512 << 20


@pytest.fixture
def bounded():
    """The test may not raise the process's peak memory by more than MOST_GROWTH."""
    unit = 1 if sys.platform == "darwin" else 1024
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit - before < MOST_GROWTH


def written(folder: Path, kind: str) -> Path:
    arrays = random_network("FlexibleNeRFModel", 0)
    path = folder / f"{kind}.{'npz' if kind == 'npz' else 'ckpt'}"
    if kind == "npz":
        np.savez(path, **arrays)
    else:
        weights = {name: torch.from_numpy(array) for name, array in arrays.items()}
        torch.save({"model_fine_state_dict": weights}, path, _use_new_zipfile_serialization=kind == "zip")
    return path


@pytest.mark.parametrize("kind", ["npz", "zip", "legacy"])
def test_files_cut_off_anywhere(tmp_path: Path, kind: str, bounded: None) -> None:
    whole = written(tmp_path, kind)
    content = whole.read_bytes()
    for tenth in range(1, 10):
        whole.write_bytes(content[: len(content) * tenth // 10])
        nerf.sniff(whole)
        with pytest.raises(InputError, match=whole.name):
            source.read_density(whole, nerf.NerfConfig())


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_grids_cut_off_or_with_headers_that_lie(tmp_path: Path, suffix: str, bounded: None) -> None:
    path = tmp_path / f"grid{suffix}"
    options = nerf.NerfConfig.model_validate({"bounds": [[-1, -1, -1], [1, 1, 1]]})
    values = np.random.default_rng(0).uniform(0, 50, (20, 20, 20)).astype(np.float32)
    np.save(path, values) if suffix == ".npy" else np.savez(path, density=values)
    content = path.read_bytes()
    source.read_density(path, options)
    for tenth in range(10):
        path.write_bytes(content[: len(content) * tenth // 10])
        nerf.sniff(path)
        with pytest.raises(InputError, match=path.name):
            source.read_density(path, options)
    for shape in ((-20, 20, 20), (2**31, 20, 20), (2**62, 2**62, 20), (21, 20, 20)):
        header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".encode()
        array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + values.tobytes()
        path.write_bytes(array)
        if suffix == ".npz":
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("density.npy", array)
        nerf.sniff(path)
        with pytest.raises(InputError, match=path.name):
            source.read_density(path, options)


@pytest.mark.parametrize("kind", ["npz", "zip", "legacy"])
def test_flipped_bytes_are_an_error_or_a_result(tmp_path: Path, kind: str, bounded: None) -> None:
    path = written(tmp_path, kind)
    content = path.read_bytes()
    rng = np.random.default_rng(0)
    for place in [*range(0, 64, 9), *rng.integers(0, min(4096, len(content)), 12).tolist()]:
        path.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        nerf.sniff(path)
        try:
            source.read_density(path, nerf.NerfConfig())
        except InputError as error:
            assert str(error)


@pytest.mark.parametrize("count", [-1, 2**31, 2**40, 2**62])
def test_a_legacy_checkpoint_that_claims_more_than_it_holds(tmp_path: Path, count: int, bounded: None) -> None:
    path = written(tmp_path, "legacy")
    # A storage's number of elements is a pickled integer behind its device's name.
    content = path.read_bytes()
    number = pickle.dumps(8 * 21, 2)[2:-1]
    assert number in content
    path.write_bytes(content.replace(number, pickle.dumps(count, 2)[2:-1]))
    with pytest.raises(InputError, match=r"legacy\.ckpt"):
        ndf_core.open(path, repr="nerf")


def test_archives_that_unpack_to_more_than_is_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bounded: None
) -> None:
    monkeypatch.setattr(source, "MOST_BYTES", 64 << 20)
    monkeypatch.setattr(checkpoint, "MOST_BYTES", 64 << 20)
    for name, member in (("bomb.npz", "layer1.weight.npy"), ("bomb.ckpt", "a/data.pkl")):
        with (
            zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive,
            archive.open(member, "w") as file,
        ):
            np.lib.format.write_array_header_1_0(
                file, {"descr": "<f4", "fortran_order": False, "shape": (65, 1 << 18)}
            )
            for _ in range(65):
                file.write(bytes(1 << 20))
        nerf.sniff(tmp_path / name)
        with pytest.raises(InputError, match=rf"{name}: .*(allowed|64 MiB)"):
            source.read_density(tmp_path / name, nerf.NerfConfig())


@pytest.mark.parametrize(
    "content", [b"PK\x03\x04", b"\x93NUMPY", b"\x80\x02.", b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.", b"GIF89a"]
)
def test_a_beginning_and_no_more(tmp_path: Path, content: bytes) -> None:
    for suffix in (".npz", ".npy", ".ckpt"):
        path = tmp_path / f"a{suffix}"
        path.write_bytes(content)
        assert nerf.sniff(path) is None
        with pytest.raises(InputError, match=path.name):
            ndf_core.open(path, repr="nerf")


def test_densities_that_are_no_numbers(tmp_path: Path) -> None:
    box = [[-1, -1, -1], [1, 1, 1]]
    side = np.linspace(-1, 1, 17)
    points = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1)
    values = np.where(np.linalg.norm(points, axis=-1) < 0.6, 100.0, 0.0)
    values[8, 8, 8], values[0, 0, 0], values[1, 1, 1] = np.nan, np.inf, -np.inf
    np.savez(tmp_path / "a.npz", density=values, bounds=np.array(box))
    surface = ndf_core.open(tmp_path / "a.npz", resolution=16)
    assert "3 samples are not finite and count as empty" in surface.notes
    for bad in (np.full_like(values, np.nan), np.zeros_like(values), np.full_like(values, -1e30)):
        np.savez(tmp_path / "b.npz", density=bad, bounds=np.array(box))
        with pytest.raises(InputError, match="nothing is denser than fog"):
            ndf_core.open(tmp_path / "b.npz", resolution=16)
    np.savez(tmp_path / "c.npz", density=np.full_like(values, 1e30), bounds=np.array(box))
    with pytest.raises(InputError, match="no closed object"):
        ndf_core.open(tmp_path / "c.npz", resolution=16)
    np.savez(tmp_path / "d.npz", density=values, bounds=np.array(box)[::-1])
    with pytest.raises(InputError, match="bounds are no box"):
        ndf_core.open(tmp_path / "d.npz", resolution=16)
