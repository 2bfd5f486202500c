"""`ndf info` and `ndf extract` on small assets made by hand."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from small_assets import small_content, torus

from ndf_core.asset.asset import Asset
from ndf_core.cli import main

KEYS = {"vertices", "faces", "edge_length", "manifold", "closed", "delaunay", "delaunay_extrinsic", "folded_area",
        "self_intersections", "seconds", "seconds_by_stage"}  # fmt: skip


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    path = tmp_path / "torus.ndf"
    Asset(small_content(torus(), amplitude=0.01, center=(10.0, 20.0, 30.0), scale=2.0)).save(path)
    return path


def test_info_says_what_is_in_the_file(asset: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(asset), "--json"]) == 0
    info = json.loads(capfd.readouterr().out)
    assert info["base_mesh"]["genus"] == 1
    assert info["scale"] == 2.0
    assert info["center"] == [10.0, 20.0, 30.0]
    assert main(["info", str(asset)]) == 0
    text = capfd.readouterr().out
    assert "genus: 1" in text
    assert "closed: yes" in text


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".glb", ".off"])
def test_extract_writes_the_mesh_that_it_reports(asset: Path, suffix: str, capfd: pytest.CaptureFixture[str]) -> None:
    output = asset.with_suffix(suffix)
    assert main(["extract", str(asset), "-o", str(output), "--edge-length", "0.2", "--json"]) == 0
    report = json.loads(capfd.readouterr().out)
    assert report.keys() >= KEYS
    assert report["seconds"] > report["seconds_by_stage"]["total"] > 0
    mesh = trimesh.load(output, force="mesh")
    assert isinstance(mesh, trimesh.Trimesh)
    mesh.merge_vertices()
    assert (len(mesh.vertices), len(mesh.faces)) == (report["vertices"], report["faces"])
    assert mesh.is_watertight
    assert mesh.volume > 0
    assert np.abs(mesh.bounds.mean(axis=0) - (10, 20, 30)).max() < 0.3, "in the coordinates of the input"


@pytest.mark.parametrize("length", ["0", "-1", "nan", "inf"])
def test_an_edge_length_that_is_none_is_refused(asset: Path, length: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["extract", str(asset), "-o", str(asset.with_suffix(".ply")), "--edge-length", length]) == 2
    assert "must be a positive length" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("output", "message"),
    [("x.xyz", "the output must end in"), ("none/x.ply", "there is no folder"), ("torus.ndf", "must end in")],
)
def test_a_bad_output_is_refused(asset: Path, output: str, message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["extract", str(asset), "-o", str(asset.parent / output)]) == 2
    assert message in capfd.readouterr().err


@pytest.mark.parametrize("content", [b"", b"noise" * 100, None])
@pytest.mark.parametrize("command", [["info"], ["extract", "-o", "OUT"]])
def test_a_bad_asset_is_one_message(
    tmp_path: Path, content: bytes | None, command: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "bad.ndf", str(tmp_path / "out.ply")
    path.mkdir() if content is None else path.write_bytes(content)
    assert main([*(out if word == "OUT" else word for word in command), str(path)]) == 3
    err = capfd.readouterr().err
    assert err.startswith("error: ")
    assert str(path) in err
    assert "Traceback" not in err
    assert [entry.name for entry in tmp_path.iterdir()] == ["bad.ndf"]


def test_the_light_commands_import_nothing_heavy(asset: Path, tmp_path: Path) -> None:
    heavy = {"torch", "scipy", "igl", "rich", "pydantic", "pluggy", "trimesh", "ndf_core.plugins", "ndf_core.fitting"}
    for command in (["info", str(asset)], ["extract", str(asset), "-o", str(tmp_path / "x.ply")]):
        code = (
            "import sys\nfrom ndf_core.cli import main\n"
            f"code = main({command!r})\nprint(*sys.modules, file=sys.stderr)\nsys.exit(code)"
        )
        done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
        assert not heavy & set(done.stderr.splitlines()[-1].split()), command
