"""`ndf heat`, `directions`, `stripes`, `logmap`, `sample`, and paths in `ndf geodesics`, on a sphere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from small_assets import icosphere, small_content

from ndf_core.asset.asset import Asset
from ndf_core.cli import main
from ndf_core.meshio import write_mesh


@pytest.fixture
def sphere(tmp_path: Path) -> Path:
    write_mesh(tmp_path / "sphere.obj", *icosphere(3))
    return tmp_path / "sphere.obj"


def run(capfd: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capfd.readouterr().out)


@pytest.mark.parametrize(
    ("words", "array", "facts"),
    [
        (["heat", "--source", "0,0,1", "--time", "0.2"], "heat", {"least": (0, 0.1), "largest": (0.3, 0.6)}),
        (["directions", "-n", "2"], "directions", {"index_sum": (2, 2), "singular_faces": (4, 4)}),
        (["stripes", "--period", "0.5"], "stripes", {"mean_period": (0.4, 0.55)}),
        (["logmap", "--source", "0,0,1"], "log_map", {"largest_distance": (2.0, 3.6)}),
    ],
)
def test_each_writes_a_ply_an_npz_and_a_picture(
    sphere: Path, words: list[str], array: str, facts: dict, capfd: pytest.CaptureFixture[str]
) -> None:
    picture = sphere.with_suffix(".png")
    report = run(capfd, words[0], sphere, *words[1:], "-o", sphere.with_suffix(".npz"), "--png", picture)
    for name, (low, high) in facts.items():
        assert low <= report[name] <= high
    with np.load(sphere.with_suffix(".npz")) as arrays:
        assert len(arrays[array]) == report["vertices"] == 642
        assert np.isfinite(arrays[array]).all()
    assert picture.read_bytes().startswith(b"\x89PNG")
    run(capfd, words[0], sphere, *words[1:], "-o", sphere.with_suffix(".ply"))
    assert len(np.unique(trimesh.load(sphere.with_suffix(".ply"), process=False).visual.vertex_colors, axis=0)) > 10


def test_paths(sphere: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = sphere.with_suffix(".npz")
    report = run(capfd, "geodesics", sphere, "--source", "0,0,1", "--to", "0,1,0", "--to", "1,0,0", "-o", out)
    assert report["path_lengths"] == pytest.approx([np.pi / 2] * 2, rel=0.01)
    with np.load(out) as arrays:
        assert arrays["path_1"][0] == pytest.approx([0, 0, 1], abs=0.01)
        assert arrays["path_1"][-1] == pytest.approx([1, 0, 0], abs=0.01)


def test_samples(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    asset = tmp_path / "ball.ndf"
    Asset(small_content(icosphere(2), amplitude=0.0)).save(asset)
    picture = tmp_path / "dots.png"
    report = run(capfd, "sample", asset, "--count", 300, "-o", tmp_path / "dots.ply", "--png", picture)
    cloud = trimesh.load(tmp_path / "dots.ply")
    assert len(cloud.vertices) == report["points"] == pytest.approx(300, rel=0.2)
    assert picture.read_bytes().startswith(b"\x89PNG")
    report = run(capfd, "sample", asset, "--noise", "white", "--count", 77, "-o", tmp_path / "dots.npz")
    with np.load(tmp_path / "dots.npz") as arrays:
        assert arrays["points"].shape == arrays["normals"].shape == (77, 3)


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["heat", "IN", "--source", "0,0", "--time", "1"], 2, "three numbers with commas"),
        (["heat", "IN", "--source", "0,0,1", "--time", "-1"], 2, "--time -1: must be positive"),
        (["heat", "IN", "--source", "0,0,1", "--time", "1", "--steps", "0"], 2, "at least 1"),
        (["directions", "IN", "-n", "13"], 2, "13"),
        (["stripes", "IN", "--period", "nan"], 2, "must be positive"),
        (["stripes", "IN", "--period", "0.01"], 3, "at least two edges long"),
        (["logmap", "IN", "--source", "x"], 2, "three numbers with commas"),
        (["geodesics", "IN", "--source", "0,0,1", "--to", "1"], 2, "--to 1: must be three numbers"),
        (["sample", "IN", "--count", "5"], 3, "not an .ndf asset"),
        (["sample", "IN"], 2, "give --count or --radius"),
        (["sample", "IN", "--radius", "1", "--noise", "white"], 2, "--radius is for blue noise"),
    ],
)
def test_what_is_wrong_is_one_message(
    sphere: Path, words: list[str], code: int, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    out = sphere.with_name("out.ply")
    assert main([*(str(sphere) if word == "IN" else word for word in words), "-o", str(out)]) == code
    error = capfd.readouterr().err
    assert error.startswith("error: ") and message in error
    assert not out.exists()
