"""Mesh writers, read back by trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from jaxtyping import Float, Int
from numpy import ndarray as Array
from small_assets import icosphere, torus

from ndf_core.errors import OutputError
from ndf_core.meshio import SUFFIXES, write_mesh

COLORED = (".ply", ".obj", ".glb")


def read(path: Path) -> trimesh.Trimesh:
    return trimesh.load(path, process=False, force="mesh")


def corners_of(mesh: trimesh.Trimesh) -> Float[Array, "f 3 3"]:
    """Positions by face: an .stl has no indices, and other readers may reorder vertices."""
    return np.asarray(mesh.vertices, dtype=np.float64)[np.asarray(mesh.faces)]


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".PLY", ".Obj"])
@pytest.mark.parametrize("mesh", [icosphere(1), torus()], ids=["sphere", "torus"])
def test_round_trip(suffix: str, mesh: tuple[Array, Array], tmp_path: Path) -> None:
    vertices, faces = mesh[0] * 3.7 + np.array([0.1, 0.2, 0.3]), mesh[1]
    write_mesh(tmp_path / f"m{suffix}", vertices, faces)
    again = read(tmp_path / f"m{suffix}")
    np.testing.assert_allclose(corners_of(again), vertices[faces], rtol=0, atol=1e-6)
    assert again.volume == pytest.approx(trimesh.Trimesh(vertices, faces).volume, rel=1e-5)  # orientation too
    assert [path.name for path in tmp_path.iterdir()] == [f"m{suffix}"]


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".off", ".glb"])
@pytest.mark.parametrize("size", [1e-6, 1.0])
def test_small_features_far_from_the_origin(suffix: str, size: float, tmp_path: Path) -> None:
    """Coordinates around 1e6: nothing moves by more than float64's own grid there, 1e-4 of a side of 1e-6."""
    center = np.array([1e6, -1e6, 5e5])
    vertices, faces = icosphere(1)
    write_mesh(tmp_path / f"m{suffix}", vertices * size + center, faces)
    again = corners_of(read(tmp_path / f"m{suffix}")) - center
    allowed = max(1e-6 * size, 2.0**-32)
    np.testing.assert_allclose(again, vertices[faces] * size, rtol=0, atol=allowed)


def test_single_precision_only_where_it_does(tmp_path: Path) -> None:
    vertices, faces = icosphere(1)
    for shift, word in ((0.0, b"float"), (1e3, b"double")):
        write_mesh(tmp_path / "m.ply", vertices + shift, faces)
        assert b"property " + word + b" x" in (tmp_path / "m.ply").read_bytes()


@pytest.mark.parametrize("suffix", COLORED)
def test_colors(suffix: str, tmp_path: Path) -> None:
    vertices, faces = icosphere(1)
    colors = np.random.default_rng(0).integers(0, 256, size=vertices.shape).astype(np.uint8)
    write_mesh(tmp_path / f"m{suffix}", vertices, faces, colors)
    again = read(tmp_path / f"m{suffix}")
    np.testing.assert_allclose(corners_of(again), vertices[faces], rtol=0, atol=1e-6)
    assert isinstance(again.visual, trimesh.visual.ColorVisuals)
    found = np.asarray(again.visual.vertex_colors)[np.asarray(again.faces)][..., :3]
    np.testing.assert_allclose(found.astype(int), colors[faces].astype(int), atol=1)


def test_colors_of_off(tmp_path: Path) -> None:
    """trimesh reads no colours from .off."""
    vertices, faces = icosphere(0)
    colors = np.arange(36, dtype=np.uint8).reshape(12, 3)
    write_mesh(tmp_path / "m.off", vertices, faces, colors)
    lines = (tmp_path / "m.off").read_text().splitlines()
    assert lines[:2] == ["COFF", "12 20 0"]
    rows = np.array([line.split() for line in lines[2:14]], dtype=np.float64)
    np.testing.assert_allclose(rows[:, :3], vertices, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(rows[:, 3:], np.hstack([colors, np.full((12, 1), 255)]))
    np.testing.assert_allclose(corners_of(read(tmp_path / "m.off")), vertices[faces], rtol=0, atol=1e-8)


def test_many_faces_in_chunks(tmp_path: Path) -> None:
    """More lines than are formatted at a time."""
    vertices, faces = icosphere(6)
    for suffix in (".obj", ".off"):
        write_mesh(tmp_path / f"m{suffix}", vertices, faces)
        again = read(tmp_path / f"m{suffix}")
        np.testing.assert_array_equal(np.asarray(again.faces), faces)
        np.testing.assert_allclose(np.asarray(again.vertices), vertices, rtol=0, atol=1e-8)


SPHERE = icosphere(0)


@pytest.mark.parametrize(
    ("name", "vertices", "faces", "colors", "message"),
    [
        ("m.step", *SPHERE, None, r"\.step suffix; use one of \.ply, \.obj, \.stl, \.glb, \.off"),
        ("mesh", *SPHERE, None, "no suffix; use one of"),
        ("none/m.ply", *SPHERE, None, "there is no folder"),
        ("m.ply", SPHERE[0] * np.nan, SPHERE[1], None, "not finite"),
        ("m.ply", SPHERE[0][:5], SPHERE[1], None, "does not exist"),
        ("m.ply", SPHERE[0], SPHERE[1] - 1, None, "does not exist"),
        ("m.stl", *SPHERE, np.zeros((12, 3), np.uint8), r"colours to an \.stl"),
    ],
)
def test_refused_and_nothing_left_behind(
    name: str, vertices: Array, faces: Int[Array, "f 3"], colors: Array | None, message: str, tmp_path: Path
) -> None:
    with pytest.raises(OutputError, match=message):
        write_mesh(tmp_path / name, vertices, faces, colors)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_its_place(tmp_path: Path) -> None:
    (tmp_path / "m.ply").mkdir()
    with pytest.raises(OutputError, match="folder"):
        write_mesh(tmp_path / "m.ply", *SPHERE)


def test_values_of_vertices(tmp_path: Path) -> None:
    vertices, faces = icosphere(1)
    values = {"distance": vertices[:, 2] + 1, "color": np.where(vertices[:, 0] > 0, np.inf, 0.5)}
    colors = np.full(vertices.shape, 77, np.uint8)
    write_mesh(tmp_path / "m.ply", vertices, faces, colors, values)
    again = trimesh.load(tmp_path / "m.ply", process=False)
    stored = again.metadata["_ply_raw"]["vertex"]["data"]
    for name, numbers in values.items():
        np.testing.assert_array_equal(np.ravel(stored[name]), numbers.astype(np.float32))
    np.testing.assert_allclose(again.vertices, vertices, atol=1e-6)
    with pytest.raises(OutputError, match=r"only a \.ply holds values"):
        write_mesh(tmp_path / "m.obj", vertices, faces, None, values)
