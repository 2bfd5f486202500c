"""The wheel of ndf-core alone, with nothing but its light dependencies, in a virtual environment of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
from small_assets import small_content, torus

from ndf_core.asset.asset import Asset

REPOSITORY = Path(__file__).resolve().parents[2]
HEAVY = ("torch", "scipy", "igl", "open3d", "trimesh", "rich", "skimage")

pytestmark = pytest.mark.slow


def run(*command: str | Path) -> str:
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def client(core_wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of executables of an environment with the wheel in it."""
    folder = tmp_path_factory.mktemp("client")
    venv.create(folder)
    pip = [sys.executable, "-m", "pip", "--python", folder / "bin" / "python"]
    run(*pip, "install", "--quiet", "--no-compile", core_wheel)
    return folder / "bin"


def test_the_wheel_holds_kernels_and_recipes_and_serves_every_later_python(core_wheel: Path) -> None:
    assert "-cp311-abi3-" in core_wheel.name
    names = zipfile.ZipFile(core_wheel).namelist()
    for source in (REPOSITORY / "ndf_core" / "kernels" / "src").glob("*.c"):
        assert any(name.startswith(f"ndf_core/kernels/_{source.stem}.abi3") for name in names), source.stem
    assert {"ndf_core/config/recipes/fast.toml", "ndf_core/config/recipes/paper.toml", "ndf_core/py.typed",
            "ndf_core/scaffold/template/@dot@github/workflows/ci.yml.in"} <= {*names}  # fmt: skip
    assert {name.partition("/")[0] for name in names if "dist-info" not in name} == {"ndf_core"}


def test_the_light_client_has_nothing_heavy_and_says_what_it_lacks(client: Path, tmp_path: Path) -> None:
    code = f"import importlib.util as u; print([n for n in {HEAVY!r} if u.find_spec(n)])"
    assert run(client / "python", "-c", code).strip() == "[]"
    assert json.loads(run(client / "ndf", "plugins", "--check", "--json")) == []
    (tmp_path / "x.obj").write_text("v 0 0 0\n")
    fit = subprocess.run(
        [client / "ndf", "fit", tmp_path / "x.obj", "-o", tmp_path / "x.ndf"], capture_output=True, text=True
    )
    assert fit.returncode == 2
    assert "pip install ndf-plugin-sdf" in fit.stderr


def test_the_light_client_reads_and_extracts(client: Path, tmp_path: Path) -> None:
    asset = tmp_path / "torus.ndf"
    Asset(small_content(torus())).save(asset)
    assert json.loads(run(client / "ndf", "info", asset, "--json"))["base_mesh"]["genus"] == 1
    for suffix in (".ply", ".obj"):
        output = tmp_path / f"torus{suffix}"
        report = json.loads(run(client / "ndf", "extract", asset, "-o", output, "--json"))
        assert report["closed"]
        assert report["manifold"]
        assert output.stat().st_size > 10_000
