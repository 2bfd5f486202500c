"""Meshes of files, made fit to compute on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_assets import icosphere, open_grid, small_content

from ndf_core.asset.asset import Asset
from ndf_core.errors import AssetError, ConfigError, InputError
from ndf_core.kernels.mesh_check import check_mesh
from ndf_core.mesh import signed_volume
from ndf_core.meshio import write_mesh
from ndf_core.processing.mesh_input import manifold_mesh, read_input


def test_a_closed_mesh_stays_as_it_is() -> None:
    vertices, faces = icosphere(2)
    found = manifold_mesh(vertices, faces, "x")
    np.testing.assert_array_equal(found.vertices, vertices)
    np.testing.assert_array_equal(found.faces, faces)
    assert found.notes == ()


def test_a_border_is_fine() -> None:
    vertices, faces = open_grid(4)
    found = manifold_mesh(vertices, faces, "x")
    np.testing.assert_array_equal(found.faces, faces)


def test_triangles_without_indices_are_joined() -> None:
    vertices, faces = icosphere(2)
    found = manifold_mesh(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3), "x")
    check = check_mesh(found.faces, len(found.vertices))
    assert (check.closed, check.manifold, len(found.vertices)) == (True, True, len(vertices))
    assert "merged" in found.notes[0]


def test_coincident_vertices_stay_where_merging_makes_the_mesh_worse() -> None:
    """Two open sheets that touch along an edge each has as a border."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])
    fan = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    found = manifold_mesh(vertices[fan].reshape(-1, 3), np.arange(9).reshape(-1, 3), "x")
    assert len(found.vertices) == 9


def test_faces_are_turned_to_agree_and_outwards() -> None:
    vertices, faces = icosphere(2)
    mixed = faces.copy()
    mixed[::7] = mixed[::7, ::-1]
    assert any("turned over" in note for note in manifold_mesh(vertices, mixed, "x").notes)
    for wrong in (mixed, faces[:, ::-1]):
        found = manifold_mesh(vertices, wrong, "x")
        assert check_mesh(found.faces, len(found.vertices)).manifold
        assert signed_volume(found.vertices, found.faces) > 0
    sheet, grid = open_grid(3)
    grid[::2] = grid[::2, ::-1]
    assert not check_mesh(manifold_mesh(sheet, grid, "x").faces, len(sheet)).inconsistent_edges


def test_unused_vertices_and_degenerate_faces_go() -> None:
    vertices, faces = icosphere(1)
    found = manifold_mesh(np.concatenate([np.full((1, 3), np.nan), vertices]), np.r_[faces + 1, [[1, 1, 2]]], "x")
    assert len(found.vertices) == len(vertices)
    assert len(found.faces) == len(faces)
    assert "1 degenerate triangles" in found.notes[0]


def test_refused() -> None:
    vertices, faces = icosphere(1)
    crowded = np.concatenate([faces, [[faces[0, 0], faces[0, 1], len(vertices)]]])
    with pytest.raises(InputError, match="1 edges with more than two triangles"):
        manifold_mesh(np.concatenate([vertices, [[9.0, 9, 9]]]), crowded, "x")
    with pytest.raises(InputError, match="does not exist"):
        manifold_mesh(vertices, faces + 1, "x")
    with pytest.raises(InputError, match="does not exist"):
        manifold_mesh(vertices, faces - 1, "x")
    with pytest.raises(InputError, match="degenerate"):
        manifold_mesh(vertices, np.zeros((3, 3), dtype=np.int64), "x")
    vertices[0] = np.inf
    with pytest.raises(InputError, match="1 vertices are not finite"):
        manifold_mesh(vertices, faces, "x")
    strip = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [4, 5, 1], [1, 5, 0]])
    with pytest.raises(InputError, match="one-sided"):
        manifold_mesh(np.random.default_rng(0).normal(size=(6, 3)), strip, "x")


def test_assets_and_meshes_are_told_apart_by_content(tmp_path: Path) -> None:
    Asset(small_content(icosphere(1))).save(tmp_path / "a.ndf")
    (tmp_path / "a.ndf").rename(tmp_path / "a.obj")
    assert read_input(tmp_path / "a.obj").extracted is not None
    write_mesh(tmp_path / "m.ply", *icosphere(1))
    assert read_input(tmp_path / "m.ply").extracted is None
    with pytest.raises(ConfigError, match="is for assets"):
        read_input(tmp_path / "m.ply", edge_length=0.1)
    (tmp_path / "bad.ndf").write_bytes(b"not an asset")
    with pytest.raises(AssetError):
        read_input(tmp_path / "bad.ndf")
    with pytest.raises(InputError, match="cannot be read"):
        read_input(tmp_path / "none.ply")


@pytest.mark.parametrize("name", ["mesh/spot.obj", "mesh/trimesh_featuretype.STL", "soup/face.obj"])
def test_real_files(shared_data: Path, name: str) -> None:
    found = read_input(shared_data / name)
    check = check_mesh(found.faces, len(found.vertices))
    assert not (check.non_manifold_edges or check.inconsistent_edges or check.unused_vertices)
    assert check.closed == name.startswith("mesh")


def test_a_real_file_that_is_no_manifold(shared_data: Path) -> None:
    with pytest.raises(InputError, match=r"not a manifold: .* --repr soup"):
        read_input(shared_data / "soup/truck.obj")
