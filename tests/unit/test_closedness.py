"""The look that decides between `mesh` and `soup`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from ndf_core.readers import closedness
from ndf_core.readers.closedness import is_closed


def test_a_mesh_is_closed_without_one_triangle_not(tmp_path: Path) -> None:
    ring = trimesh.creation.torus(2.0, 0.5)
    for kind in ("obj", "stl", "ply"):  # .stl has three corners of its own for each triangle
        path = tmp_path / f"ring.{kind}"
        ring.export(path)
        assert is_closed(path) is True
        part = ring.copy()
        part.update_faces(np.arange(len(ring.faces)) != 7)
        part.export(path)
        assert is_closed(path) is False


def test_rounding_of_single_precision_is_forgiven_and_no_more(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    rng = np.random.default_rng(0)
    for spread, closed in ((1e-8, True), (1e-4, False)):
        soup = box.triangles.reshape(-1, 3) + spread * rng.standard_normal((36, 3))
        faces = "\n".join(f"f {i} {i + 1} {i + 2}" for i in range(1, 36, 3))
        text = "\n".join(f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in soup)
        path = tmp_path / f"{closed}.obj"
        path.write_text(f"{text}\n{faces}\n")
        assert is_closed(path) is closed


def test_edges_of_three_triangles_do_not_close(tmp_path: Path) -> None:
    fin = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [1, 0, 3], [0, 1, 3]], process=False
    )
    fin.export(tmp_path / "fin.off")
    assert is_closed(tmp_path / "fin.off") is False


def test_what_cannot_be_read_is_neither(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "text.obj").write_text("v 0 0 0\nf 1 2 9\n")
    assert is_closed(tmp_path / "text.obj") is None
    (tmp_path / "noise.obj").write_bytes(b"\0\1\2")
    assert is_closed(tmp_path / "noise.obj") is None
    assert is_closed(tmp_path / "none.obj") is None
    trimesh.creation.box().export(tmp_path / "box.obj")
    monkeypatch.setattr(closedness, "MOST_BYTES", 10)
    assert is_closed(tmp_path / "box.obj") is None


def test_every_shared_file_is_sorted_right(shared_data: Path) -> None:
    assert all(is_closed(path) for path in (shared_data / "mesh").iterdir())
    closed = {path.name for path in (shared_data / "soup").iterdir() if is_closed(path)}
    # MANIFEST.md: neither of them has a boundary edge or a non-manifold one.
    assert closed == {"cow.obj", "trimesh_busted.STL"}
