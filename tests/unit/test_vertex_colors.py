"""Colours of mesh files: what our writers write is read back; what is no colour is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_assets import icosphere

from ndf_core.errors import InputError
from ndf_core.meshio import write_mesh
from ndf_core.readers.colors import read_vertex_colors

VERTICES, FACES = icosphere(1)
COLORS = np.random.default_rng(0).integers(0, 256, (len(VERTICES), 3)).astype(np.uint8)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".glb"])
def test_they_are_read_back(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, VERTICES, FACES, COLORS)
    found = read_vertex_colors(path)
    assert found is not None
    assert np.abs(found.points - VERTICES).max() < 1e-6
    assert np.abs(found.colors - COLORS / 255).max() < 1e-4
    write_mesh(path, VERTICES, FACES)
    assert read_vertex_colors(path) is None


def test_colours_in_floats_are_clipped_and_points_must_be_finite(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    header = ["ply", "format ascii 1.0", "element vertex 3"]
    header += [f"property float {name}" for name in ("x", "y", "z", "red", "green", "blue")]
    path.write_text("\n".join([*header, "end_header", "0 0 0 0.5 1.5 -1", "nan 0 0 1 1 1", "1 2 3 0 0 nan", ""]))
    found = read_vertex_colors(path)
    assert found is not None
    assert found.points.tolist() == [[0, 0, 0]]
    assert found.colors.tolist() == [[0.5, 1, 0]]


def test_what_is_no_file_of_colours(tmp_path: Path) -> None:
    assert read_vertex_colors("module:function") is None
    assert read_vertex_colors(VERTICES) is None
    path = tmp_path / "mesh.stl"
    write_mesh(path, VERTICES, FACES)
    assert read_vertex_colors(path) is None
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nend_header\n1\n")
    with pytest.raises(InputError, match="its colours cannot be read"):
        read_vertex_colors(broken)
    mixed = tmp_path / "mixed.obj"
    mixed.write_text("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert read_vertex_colors(mixed) is None
