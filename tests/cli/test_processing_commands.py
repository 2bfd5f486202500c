"""`ndf geodesics` and `ndf spectrum` on small assets and mesh files."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from small_assets import icosphere, small_content

from ndf_core.asset.asset import Asset
from ndf_core.cli import main
from ndf_core.meshio import write_mesh

COMMANDS = {"geodesics": ["--source", "0,0,1"], "spectrum": ["-k", "5"]}


@pytest.fixture
def sphere(tmp_path: Path) -> Path:
    write_mesh(tmp_path / "sphere.obj", *icosphere(3))
    return tmp_path / "sphere.obj"


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    content = small_content(icosphere(1), amplitude=0.0, center=(10.0, 20.0, 30.0), scale=2.0)
    Asset(content).save(tmp_path / "ball.ndf")
    return tmp_path / "ball.ndf"


def run(capfd: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capfd.readouterr().out)


def vertex_data(path: Path) -> np.ndarray:
    return trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]


@pytest.mark.parametrize("method", ["heat", "exact"])
def test_geodesics_of_a_mesh_file(sphere: Path, method: str, capfd: pytest.CaptureFixture[str]) -> None:
    out, picture = sphere.with_suffix(".ply"), sphere.with_suffix(".png")
    drawn = ["--png", picture] if method == "exact" else []
    report = run(capfd, "geodesics", sphere, "--source", "0,0,2", "--method", method, "-o", out, *drawn)
    data = vertex_data(out)
    true = np.arccos(np.clip(np.ravel(data["z"]), -1, 1))
    assert np.abs(np.ravel(data["distance"]) - true).max() < 0.05
    assert len(np.unique(np.ravel(data["green"]))) > 20
    assert report["sources"][0] == pytest.approx([0, 0, 1], abs=0.01)
    assert report["source_offsets"] == pytest.approx([1.0], abs=0.01)
    assert report["largest_distance"] == pytest.approx(np.pi, abs=0.05)
    assert report["unreached_vertices"] == report["unreached_components"] == 0
    assert report["seconds"].keys() == {"read", "solve", "write"}
    assert picture.exists() == bool(drawn)


def test_geodesics_of_an_asset(asset: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In the coordinates of the input; each vertex knows its base point."""
    out = asset.with_suffix(".npz")
    points = ["--source", "10,20,40", "--source=-10,20,30"]
    run(capfd, "geodesics", asset, *points, "--edge-length", 0.5, "-o", out)
    with np.load(out) as arrays:
        assert np.abs(arrays["vertices"].mean(axis=0) - (10, 20, 30)).max() < 0.1
        assert arrays["source_positions"].shape == (2, 3)
        assert arrays["distances"].shape == arrays["base_faces"].shape == (len(arrays["base_barycentric"]),)
        nearest = np.linalg.norm(arrays["vertices"][:, None] - arrays["source_positions"], axis=2).min(axis=1)
        assert (arrays["distances"] > nearest - 0.3).all()


def test_spectrum_of_a_mesh_file(sphere: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out, picture = sphere.with_suffix(".ply"), sphere.with_suffix(".png")
    report = run(capfd, "spectrum", sphere, "-k", "5", "-o", out, "--png", picture)
    assert report["eigenvalues"] == pytest.approx([0, 2, 2, 2, 6], rel=0.02, abs=1e-9)
    assert report["area"] == pytest.approx(4 * np.pi, rel=0.01)
    data = vertex_data(out)
    assert [name for name in data.dtype.names if name.startswith("eigen")] == [f"eigenfunction_{i}" for i in range(5)]
    assert np.ptp(np.ravel(data["eigenfunction_0"])) < 1e-6
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_spectrum_of_an_asset(asset: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = asset.with_suffix(".npz")
    report = run(capfd, "spectrum", asset, "--count", "3", "--mass", "lumped", "--edge-length", "0.5", "-o", out)
    with np.load(out) as arrays:
        assert arrays["eigenvalues"].tolist() == report["eigenvalues"]
        assert arrays["eigenfunctions"].shape == (report["vertices"], 3)
        assert {"faces", "base_faces", "base_barycentric"} <= set(arrays)


def test_without_json_the_report_is_text(sphere: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["geodesics", str(sphere), "--source", "0,0,1", "-o", str(sphere.with_suffix(".npz"))]) == 0
    assert "unreached components: 0" in capfd.readouterr().out


def test_parts_without_a_source_are_infinitely_far_and_said_to_be(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    vertices, faces = icosphere(2)
    both = np.concatenate([vertices, vertices + 5]), np.concatenate([faces, faces + len(vertices)])
    write_mesh(tmp_path / "two.ply", *both)
    report = run(capfd, "geodesics", tmp_path / "two.ply", "--source", "0,0,1", "-o", tmp_path / "out.ply")
    assert report["unreached_vertices"] == len(vertices)
    assert report["unreached_components"] == 1
    data = vertex_data(tmp_path / "out.ply")
    assert np.isinf(np.ravel(data["distance"])[len(vertices) :]).all()
    assert (np.ravel(data["red"])[len(vertices) :] == 128).all(), "grey"


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["geodesics", "IN", "-o", "out.ply"], 2, "--source"),
        (["geodesics", "IN", "--source", "1,2", "-o", "out.ply"], 2, "three numbers with commas"),
        (["geodesics", "IN", "--source", "1,2,inf", "-o", "out.ply"], 2, "three numbers with commas"),
        (["geodesics", "IN", "--source", "1e300,2,3", "-o", "out.ply"], 2, "three numbers with commas"),
        (["logmap", "IN", "--source", "1,2,3", "--source", "1,2,4", "-o", "out.ply"], 2, "seen from one"),
        (["geodesics", "IN", "--source", "1,2,x", "-o", "out.ply"], 2, "three numbers with commas"),
        (["geodesics", "IN", "--source", "1,2,3", "--method", "fast", "-o", "out.ply"], 2, "fast"),
        (["geodesics", "IN", "--source", "1,2,3", "-o", "out.obj"], 2, "must end in .ply .npz"),
        (["geodesics", "IN", "--source", "1,2,3", "-o", "out.ply", "--png", "out.jpg"], 2, "must end in .png"),
        (["geodesics", "IN", "--source", "1,2,3", "--edge-length", "0.1", "-o", "out.ply"], 2, "is for assets"),
        (["geodesics", "IN", "--source", "1,2,3", "--edge-length", "nan", "-o", "out.ply"], 2, "positive length"),
        (["geodesics", "none.obj", "--source", "1,2,3", "-o", "out.ply"], 3, "No such file"),
        (["spectrum", "IN", "-k", "0", "-o", "out.ply"], 2, "at least 1"),
        (["spectrum", "IN", "-k", "9999", "-o", "out.ply"], 3, "9999 eigenvalues of a mesh with 642 vertices"),
        (["spectrum", "IN", "-k", "two", "-o", "out.ply"], 2, "two"),
    ],
)
def test_what_is_wrong_is_one_message(
    sphere: Path,
    arguments: list[str],
    code: int,
    message: str,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(sphere.parent)
    assert main([sphere.name if word == "IN" else word for word in arguments]) == code
    error = capfd.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert "Traceback" not in error
    assert [path.name for path in sphere.parent.iterdir()] == [sphere.name], "nothing is left behind"


@pytest.mark.parametrize(
    "words",
    [
        ["geodesics", "--source", "0,0,0"],
        ["geodesics", "--source", "0,0,0", "--method", "exact"],
        ["spectrum", "-k", "3"],
        ["heat", "--source", "0,0,0", "--time", "1"],
        ["directions"],
        ["stripes", "--period", "1"],
        ["logmap", "--source", "0,0,0"],
    ],
)
@pytest.mark.parametrize("size", [0.0, 1.0])
def test_a_mesh_along_a_line_is_refused(
    words: list[str], size: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    vertices, faces = icosphere(1)
    write_mesh(tmp_path / "line.ply", vertices * [size, 0, 0], faces)
    assert main([words[0], str(tmp_path / "line.ply"), *words[1:], "-o", str(tmp_path / "out.npz")]) == 3
    assert "the mesh has no area" in capfd.readouterr().err


def test_flat_triangles_have_no_logarithmic_map(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    vertices, faces = icosphere(2)
    write_mesh(tmp_path / "flat.ply", vertices * [1, 1, 0], faces)
    words = ["logmap", str(tmp_path / "flat.ply"), "--source", "0,0,0", "-o", str(tmp_path / "out.npz")]
    assert main(words) == 3
    assert "16 triangles have no area" in capfd.readouterr().err


def test_stripes_wider_than_the_surface_leave_one(sphere: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = sphere.with_suffix(".npz")
    run(capfd, "stripes", sphere, "--period", "1e9", "-o", out)
    with np.load(out) as arrays:
        assert np.isfinite(arrays["stripes"]).all()


@pytest.mark.parametrize(("command", "package"), [("geodesics", "scipy"), ("spectrum", "cholespy")])
def test_a_missing_package_names_the_extra(sphere: Path, command: str, package: str) -> None:
    words = [command, str(sphere), *COMMANDS[command], "-o", str(sphere.with_suffix(".ply"))]
    code = f"import sys\nsys.modules[{package!r}] = None\nfrom ndf_core.cli import main\nsys.exit(main({words!r}))"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True)
    assert done.returncode == 3
    assert done.stderr.startswith(f"error: this needs {package}")
    assert "pip install 'ndf-core[processing]'" in done.stderr


@pytest.mark.parametrize("command", list(COMMANDS))
def test_no_torch_and_no_plugin(sphere: Path, command: str) -> None:
    words = [command, str(sphere), *COMMANDS[command], "-o", str(sphere.with_suffix(".ply"))]
    code = (
        "import sys\nfrom ndf_core.cli import main\n"
        f"code = main({words!r})\nprint(*sys.modules, file=sys.stderr)\nsys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stderr.splitlines()[-1].split())
    assert not loaded & {"torch", "igl", "trimesh", "potpourri3d", "pydantic", "pluggy", "rich"}
