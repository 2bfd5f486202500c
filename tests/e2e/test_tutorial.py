"""The tutorial, word for word: in an empty directory, in a new virtual environment, against the wheel of ndf-core."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from clean_environment import closure, make_environment
from markdown_blocks import blocks_of

REPOSITORY = Path(__file__).resolve().parents[2]
TUTORIAL = REPOSITORY / "docs" / "tutorial.md"
EXAMPLE = REPOSITORY / "examples" / "ndf_plugin_heightmap"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory, core_wheel: Path) -> Path:
    """Folder of executables of an environment that holds what ndf-core[fit] and pytest declare, and nothing else.

    ndf comes from the wheel, by the tutorial's own pip commands.
    """
    folder = tmp_path_factory.mktemp("environment")
    tools = {(name, frozenset[str]()) for name in ("pip", "pytest", "setuptools")}
    programs = make_environment(folder, closure({("ndf-core", frozenset({"fit"})), *tools}) - {"ndf-core"})
    for name, start in {
        "pip": "pip._internal.cli.main import main",
        "pytest": "pytest import console_main as main",
    }.items():
        (programs / name).write_text(f"#!{programs / 'python'}\nimport sys\nfrom {start}\n\nsys.exit(main())\n")
        (programs / name).chmod(0o755)
    return programs


def test_the_tutorial_ends_with_a_working_plugin(python: Path, core_wheel: Path, tmp_path: Path) -> None:
    environment = {
        **{name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PIP_", "COV"))},
        "PATH": os.pathsep.join([str(python), "/usr/bin", "/bin"]),
        "VIRTUAL_ENV": str(python.parent),
        "PIP_NO_INDEX": "1",
        "PIP_FIND_LINKS": str(core_wheel.parent),
        "PIP_NO_BUILD_ISOLATION": "0",  # pip's way to say that there is none: setuptools is among the dependencies
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "OMP_NUM_THREADS": "1",
    }
    place = tmp_path

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
        return done.stdout

    answers: dict[str, str] = {}
    for block in blocks_of(TUTORIAL):
        if block.title:
            assert (place / block.title).parent.is_dir(), block.title
            (place / block.title).write_text(block.text)
        elif block.language == "python":
            run("python", "-c", block.text)
        elif block.language == "bash":
            for line in block.text.splitlines():
                if line.startswith("cd "):
                    place = place / line.removeprefix("cd ")
                else:
                    answers[line] = run("bash", "-c", line)

    assert run("python", "-c", "import ndf_core; print(ndf_core.__file__)").startswith(str(python.parent))
    assert "0 broken" in answers["ndf plugins --check heightmap hills.asc"]
    (fit,) = [answer for line, answer in answers.items() if line.startswith("ndf fit hills.asc")]
    assert "representation: heightmap" in fit
    assert (place / "hills.ply").stat().st_size > 100_000
    for path in ("ndf_plugin_heightmap", "tests"):
        for file in sorted((EXAMPLE / path).glob("*.py")):
            relative = file.relative_to(EXAMPLE)
            assert (place / relative).read_text() == file.read_text(), f"{relative}: example and tutorial differ"
    for name in ("pyproject.toml", ".gitignore", ".github/workflows/ci.yml"):
        assert (place / name).read_text() == (EXAMPLE / name).read_text(), name
    made = {file.name for file in (place / "ndf_plugin_heightmap").glob("*.py")}
    assert made == {file.name for file in (EXAMPLE / "ndf_plugin_heightmap").glob("*.py")}
    assert sys.prefix not in run("python", "-c", "import sys; print(sys.path)")
