"""Each of ndf's own plugins installs beside the wheel of ndf-core with nothing but what it declares, and works."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from clean_environment import closure, make_environment
from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parents[2]
TESTS = {
    "gaussians": "test_readers.py",
    "nerf": "test_networks.py",
    "pointcloud": "test_readers.py",
    "sdf": "test_plugin.py",
}
"""A quick one of each; all of them run in the shared environment."""
PROGRAM = """
import sys
from importlib import import_module
from pkgutil import walk_packages

import pytest

code = pytest.main(["-q", "-p", "no:cacheprovider", sys.argv[2]])
for module in walk_packages(import_module(sys.argv[1]).__path__, f"{sys.argv[1]}."):
    import_module(module.name)
sys.exit(code)
"""
"""Runs tests of a plugin and imports all of it."""

pytestmark = pytest.mark.slow


def run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def test_every_plugin_is_tried() -> None:
    assert {path.parent.name.removeprefix("ndf_plugin_") for path in REPOSITORY.glob("plugins/*/pyproject.toml")} == {
        *TESTS
    }


@pytest.mark.parametrize("name", TESTS)
def test_a_plugin_works_alone(name: str, core_wheel: Path, tmp_path: Path) -> None:
    distribution, package = f"ndf-plugin-{name}", f"ndf_plugin_{name}"
    project = tmp_path / package
    products = shutil.ignore_patterns("*.egg-info", "build", "__pycache__")
    shutil.copytree(REPOSITORY / "plugins" / package, project, ignore=products)
    declared = tomllib.loads((project / "pyproject.toml").read_text())["project"]
    lines = [*declared["dependencies"], *declared["optional-dependencies"]["test"], "setuptools"]
    needs = closure({(need.name, frozenset(need.extras)) for need in map(Requirement, lines)}) - {"ndf-core"}
    python = make_environment(tmp_path / "environment", needs) / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--disable-pip-version-check"]
    run(*pip, "install", "-q", "--no-index", "--no-build-isolation", core_wheel, f"{project}[test]", cwd=tmp_path)
    shutil.rmtree(project / package)  # the tests shall find what is installed
    run(python, "-c", PROGRAM, package, project / "tests" / TESTS[name], cwd=tmp_path)
    states = json.loads(run(python, "-m", "ndf_core", "plugins", "--json", cwd=tmp_path))
    assert {(state["distribution"], state["status"]) for state in states} == {(distribution, "listed")}
