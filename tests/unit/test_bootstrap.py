"""`tools/bootstrap.py`: what it says when the system lacks something, and when it starts again."""

from __future__ import annotations

import importlib.util
import shutil
import sys
import sysconfig
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "tools" / "bootstrap.py"


@pytest.fixture
def bootstrap() -> ModuleType:
    spec = importlib.util.spec_from_file_location("bootstrap", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def only_apt(name: str) -> str | None:
    return "/usr/bin/apt" if name == "apt" else None


def test_this_machine_lacks_nothing(bootstrap: ModuleType) -> None:
    assert bootstrap.missing_from_system() == []


def test_each_missing_thing_comes_with_its_command(
    bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(shutil, "which", only_apt)
    monkeypatch.setattr(sysconfig, "get_path", lambda _name: str(tmp_path))
    monkeypatch.setattr(sys, "platform", "linux")
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    assert bootstrap.missing_from_system() == [
        "  a C compiler:  sudo apt install gcc libc6-dev",
        f"  Python's headers (Python.h):  sudo apt install python{version}-dev",
    ]


def test_a_mac_is_told_of_its_own_tools(bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    assert bootstrap.system_install("compiler") == "xcode-select --install"
    assert bootstrap.system_install("python").startswith("brew install python@3.")


def test_an_old_python_says_what_to_install(
    bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 9, 2, "final", 0))
    monkeypatch.setattr(shutil, "which", only_apt)
    monkeypatch.setattr(sys, "platform", "linux")
    assert bootstrap.main() == 1
    assert "sudo apt install python3.11 python3.11-venv python3.11-dev" in capsys.readouterr().err


@pytest.mark.parametrize("changed", ["pyproject.toml", "constraints.txt", "plugins/ndf_plugin_x/pyproject.toml",
                                     "ndf_core/kernels/src/x.c"])  # fmt: skip
def test_a_change_of_anything_that_was_installed_starts_again(
    bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, changed: str
) -> None:
    for name in ("pyproject.toml", "setup.py", "constraints.txt", "plugins/ndf_plugin_x/pyproject.toml",
                 "ndf_core/kernels/src/x.c", "ndf_core/mesh.py"):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("one")
    monkeypatch.setattr(bootstrap, "REPOSITORY", tmp_path)
    monkeypatch.setattr(bootstrap, "CONSTRAINTS", tmp_path / "constraints.txt")
    before, base = bootstrap.fingerprint(), bootstrap.base_fingerprint()
    (tmp_path / "ndf_core/mesh.py").write_text("two")
    assert bootstrap.fingerprint() == before, "editable: Python sources need no reinstall"
    (tmp_path / changed).write_text("two")
    assert bootstrap.fingerprint() != before
    assert (bootstrap.base_fingerprint() == base) is (changed != "constraints.txt"), "torch stays"


@pytest.mark.parametrize(
    ("listed", "index"),
    [("torch (2.15.0)\nAvailable versions: 2.15.0, 2.13.0+cpu, 2.13.0", False), ("Available versions: 2.13.0", True)],
)
def test_torch_comes_from_the_cpu_index_only_where_the_configured_one_has_no_cpu_build(
    bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch, listed: str, index: bool
) -> None:
    commands: list[list[str]] = []

    def call(command: list[str], **_options: object) -> int:
        commands.append(list(command))
        return 0

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("NDF_TORCH", raising=False)
    monkeypatch.setattr(bootstrap.subprocess, "run", lambda *_a, **_k: type("Done", (), {"stdout": listed}))
    monkeypatch.setattr(bootstrap.subprocess, "call", call)
    bootstrap.install_torch()
    assert len(commands) == 1
    assert commands[0][-1] == "torch==2.13.0"
    assert (bootstrap.CPU_INDEX in commands[0]) is index
