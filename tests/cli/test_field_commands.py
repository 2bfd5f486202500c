"""`ndf field fit`, `ndf field eval`, and colours in `ndf extract`, on small assets."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from small_assets import icosphere, small_content

from ndf_core.asset.asset import Asset
from ndf_core.asset.content import AssetContent, Encoding, FieldBlock
from ndf_core.cli import main
from ndf_core.meshio import write_mesh

RADIUS = 1.5
QUICK = ["--steps", "200", "--batch", "256", "--samples", "5000", "--encoding-levels", "3"]


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    Asset(small_content(icosphere(2), amplitude=0.0)).save(tmp_path / "ball.ndf")
    return tmp_path / "ball.ndf"


@pytest.fixture
def values(tmp_path: Path) -> Path:
    """As `ndf spectrum` writes them: a mesh, and more arrays than one."""
    vertices, faces = icosphere(3)
    arrays = {"height": vertices[:, 2], "side": vertices[:, 0] > 0, "eigenvalues": np.arange(3.0)}
    np.savez(tmp_path / "values.npz", vertices=vertices * RADIUS, faces=faces, **arrays)
    return tmp_path / "values.npz"


def run(capfd: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capfd.readouterr().out)


def test_fit_eval_and_info(asset: Path, values: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = asset.with_name("with.ndf")
    report = run(capfd, "field", "fit", asset, values, "--name", "h", "--values", "height", "-o", out, *QUICK)
    assert report["error"]["relative"] < 0.1
    assert report["asset_bytes"] == out.stat().st_size
    assert report["field_bytes"] == out.stat().st_size - asset.stat().st_size
    assert run(capfd, "info", out)["fields"]["h"]["kind"] == "continuous"

    mesh, picture = asset.with_suffix(".ply"), asset.with_suffix(".png")
    report = run(capfd, "field", "eval", out, "--name", "h", "-o", mesh, "--edge-length", "0.5", "--png", picture)
    data = trimesh.load(mesh, process=False).metadata["_ply_raw"]["vertex"]["data"]
    assert np.abs(np.ravel(data["h"]) - np.ravel(data["z"]) / RADIUS).max() < 0.3
    assert report["largest"] == pytest.approx(1, abs=0.1)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_eval_at_points(asset: Path, values: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out, places = asset.with_name("with.ndf"), asset.with_name("places.npz")
    run(
        capfd, "field", "fit", asset, values, "--name", "s", "--values", "side", "--kind", "binary", "-o", out, *QUICK
    )
    np.savez(places, points=np.array([[2.0, 0, 0], [-2.0, 0, 0]]))
    answer = asset.with_name("answer.npz")
    report = run(capfd, "field", "eval", out, "--name", "s", "--points", places, "-o", answer)
    with np.load(answer) as arrays:
        assert arrays["values"].tolist() == [[True], [False]]
        assert arrays["offsets"] == pytest.approx([0.5, 0.5], abs=0.05)
    assert report["points"] == 2


def test_values_of_a_ply(asset: Path, capfd: pytest.CaptureFixture[str]) -> None:
    vertices, faces = icosphere(3)
    source = asset.with_name("values.ply")
    write_mesh(source, vertices * RADIUS, faces, None, {"height": vertices[:, 2], "depth": -vertices[:, 2]})
    report = run(capfd, "field", "fit", asset, source, "--name", "both", "-o", asset.with_name("a.ndf"), *QUICK)
    assert report["labels"] == ["height", "depth"]


def test_extract_writes_the_colours(asset: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Red rises with x: a network without hidden work, in the shape that learned ones have."""
    content = Asset.load(asset).content
    weights = (np.eye(3, dtype=np.float32), np.float32([[0.2, 0, 0], [0, 0, 0], [0, 0, 0]]))
    biases = (np.full(3, 2, np.float32), np.float32([0.1, 0.25, 2.0]))
    block = FieldBlock(
        name="color",
        kind="continuous",
        domain="base",
        encoding=Encoding(1.0, 0, include_position=True),
        features=np.zeros((len(content.vertices), 0), np.float32),
        weights=weights,
        biases=biases,
        activation="relu",
        residual=False,
        labels=("red", "green", "blue"),
    )
    Asset(replace(content, fields={**content.fields, "color": block})).save(asset)
    for suffix in (".ply", ".glb"):
        out = asset.with_suffix(suffix)
        assert run(capfd, "extract", asset, "-o", out, "--edge-length", "0.7")["colored"]
        mesh = trimesh.load(out, force="mesh", process=False)
        expected = 0.1 + 0.2 * (2 + mesh.vertices[:, 0])
        assert np.abs(mesh.visual.vertex_colors[:, 0] / 255 - expected).max() < 0.005
        assert (mesh.visual.vertex_colors[:, 1:3] == [64, 255]).all()
    assert not run(capfd, "extract", asset, "-o", asset.with_suffix(".stl"), "--edge-length", "0.7")["colored"]


def test_fit_learns_the_colours_of_its_input(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ndf_core.fitting.colors._STEPS", 150)
    vertices, faces = icosphere(3)
    source, out = tmp_path / "ball.ply", tmp_path / "ball.ndf"
    write_mesh(source, vertices, faces, np.round((vertices / 2 + 0.5) * 255).astype(np.uint8))
    options = ["--faces", "80", "--steps", "30", "--batch", "256", "--threads", "1", "--feature-dim", "4"]
    report = run(capfd, "fit", source, "--colors", "-o", out, *options)
    assert report["colors"]["error"]["mean"] < 0.03
    assert report["asset_bytes"] == out.stat().st_size
    run(capfd, "extract", out, "-o", tmp_path / "out.ply", "--edge-length", "0.3")
    mesh = trimesh.load(tmp_path / "out.ply", process=False)
    directions = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    assert np.abs(mesh.visual.vertex_colors[:, :3] / 255 - (directions / 2 + 0.5)).mean() < 0.05
    plain = tmp_path / "plain.obj"
    write_mesh(plain, vertices, faces)
    assert main(["fit", str(plain), "--colors", "-o", str(out), *options]) == 2
    assert "this input has no colours" in capfd.readouterr().err


CASES = [
    (["fit", "ball.ndf", "values.npz", "--name", "h", "-o", "x.ndf"], 3, "name the values with --values"),
    (["fit", "ball.ndf", "values.npz", "--name", "h", "--values", "no", "-o", "x.ndf"], 3, "has no array 'no'"),
    (["fit", "ball.ndf", "values.npz", "--name", "inverse", "--values", "side", "-o", "x.ndf"], 2, "field name"),
    (["fit", "ball.ndf", "values.npz", "--name", "h", "--values", "eigenvalues", "-o", "x.ndf"], 3, "one row"),
    (["fit", "ball.ndf", "values.npz", "--name", "h", "--hidden", "1", "-o", "x.ndf"], 2, "--hidden"),
    (["fit", "ball.ndf", "values.npz", "--name", "h", "--values", "height", "-o", "x.ply"], 2, "must end in .ndf"),
    (["fit", "ball.ndf", "ball.ndf", "--name", "h", "-o", "x.ndf"], 3, ".npz and .ply"),
    (["eval", "ball.ndf", "--name", "h", "-o", "x.ply"], 3, "has no field 'h'"),
    (["eval", "ball.obj", "--name", "h", "-o", "x.ply"], 3, "is not an .ndf asset"),
    (["eval", "ball.ndf", "--name", "h", "--points", "values.npz", "-o", "x.npz"], 3, "needs an array `points`"),
    (["eval", "ball.ndf", "--name", "h", "--points", "values.npz", "-o", "x.ply"], 2, "must end in .npz"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "code", "message"), CASES)
def test_what_is_wrong_is_one_message(
    asset: Path,
    values: Path,
    arguments: list[str],
    code: int,
    message: str,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_mesh(asset.with_suffix(".obj"), *icosphere(1))
    monkeypatch.chdir(asset.parent)
    assert main(["field", *arguments]) == code
    error = capfd.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert not [path.name for path in asset.parent.iterdir() if path.stem == "x"], "nothing is left behind"


def test_a_field_needs_its_three_columns_to_be_a_colour(asset: Path) -> None:
    content: AssetContent = Asset.load(asset).content
    block = replace(content.fields["displacement"], name="color", kind="continuous")
    faces, weights = np.zeros(1, np.int32), np.array([[1.0, 0.0, 0.0]])
    assert Asset(replace(content, fields={**content.fields, "color": block})).colors(faces, weights) is not None
    last = (np.zeros((1, 16), np.float32), np.zeros(1, np.float32))
    layers = {"weights": (*block.weights[:-1], last[0]), "biases": (*block.biases[:-1], last[1])}
    one = replace(block, residual=False, **layers)
    assert Asset(replace(content, fields={**content.fields, "color": one})).colors(faces, weights) is None
