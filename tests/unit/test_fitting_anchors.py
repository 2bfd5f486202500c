"""Anchor files and where anchors lie."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch
from small_surfaces import small_geometry

from ndf_core.errors import ConfigError
from ndf_core.fitting import anchors as anchors_module
from ndf_core.fitting.anchors import anchor_fingerprint, place_anchors, read_anchors


def test_reads_pairs_and_skips_remarks(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("# px,py,pz,qx,qy,qz\n\n1,2,3,4,5,6\n  -1e-3, .5 ,0,0,0,1e6\n")
    np.testing.assert_array_equal(read_anchors(file), [[1, 2, 3, 4, 5, 6], [-1e-3, 0.5, 0, 0, 0, 1e6]])


@pytest.mark.parametrize(
    "line", ["1,2,3,4,5", "1,2,3,4,5,6,7", "1,2,3,4,5,x", "1,2,3,4,5,nan", "1,2,3,4,5,inf", "1;2"]
)
def test_a_bad_line_is_named(tmp_path: Path, line: str) -> None:
    file = tmp_path / "a.csv"
    file.write_text(f"# fine\n0,0,0,1,1,1\n{line}\n")
    with pytest.raises(ConfigError, match=r"a\.csv, line 3: need six finite numbers px,py,pz,qx,qy,qz"):
        read_anchors(file)


@pytest.mark.parametrize("content", [b"", b"# nothing\n\n"])
def test_no_pairs(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "a.csv"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"a\.csv: holds no pairs; give lines"):
        read_anchors(file)


def test_what_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    binary = tmp_path / "noise.csv"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ConfigError, match=r"noise\.csv: cannot be read"):
        read_anchors(binary)
    with pytest.raises(ConfigError, match=r"missing\.csv: there is no such file"):
        read_anchors(tmp_path / "missing.csv")
    with pytest.raises(ConfigError, match="there is no such file"):
        read_anchors(tmp_path)
    monkeypatch.setattr(anchors_module, "_MOST_BYTES", 3)
    with pytest.raises(ConfigError, match=r"larger than .* MB; give a few dozen pairs"):
        read_anchors(binary)


def test_a_pipe_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ConfigError, match="there is no such file"):
        read_anchors(tmp_path / "pipe.csv")


def test_anchors_start_at_the_closest_base_point_and_keep_their_targets() -> None:
    geometry = small_geometry()
    center, scale = np.array([3.0, -2.0, 8.0]), 0.5
    face = torch.tensor([3, 40, 77])
    barycentric = torch.tensor([[0.2, 0.5, 0.3], [1 / 3, 1 / 3, 1 / 3], [0.6, 0.3, 0.1]])
    # Every face of an inscribed polyhedron is the closest one to points outwards of its inside.
    on_face = geometry.positions(face, barycentric).double().numpy()
    corners = geometry.corner_positions[face].double().numpy()
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lifted = on_face + 0.3 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
    targets = np.random.default_rng(0).normal(size=(3, 3))
    pairs = np.concatenate([lifted * scale + center, targets * scale + center], axis=1)
    found = place_anchors(pairs, geometry, center, scale)
    assert torch.equal(found.base.face, face)
    torch.testing.assert_close(found.base.barycentric, barycentric, rtol=0, atol=1e-5)
    torch.testing.assert_close(found.targets, torch.from_numpy(targets).float())


def test_fingerprint_is_of_the_numbers() -> None:
    pairs = np.arange(12.0).reshape(2, 6)
    assert anchor_fingerprint(pairs) == anchor_fingerprint(np.asfortranarray(pairs.copy()))
    assert anchor_fingerprint(pairs) != anchor_fingerprint(pairs[::-1])
