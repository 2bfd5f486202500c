"""With broken third-party plugins installed everything else works, and each is explained in one line."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

from ndf_core.cli import main
from ndf_core.plugins import checking
from ndf_core.plugins.discovery import entries

if TYPE_CHECKING:
    from pathlib import Path

    from tests.conftest import PluginMaker

CAUSES = {
    "import-error": "ModuleNotFoundError: No module named 'no_such_module'",
    "wrong-version": "it speaks plugin API version 99, this ndf-core 1; upgrade ndf-core",
    "too-old": "it speaks plugin API version 0, this ndf-core 1; upgrade the plugin",
    "hangs": "did not finish within 5 s",
    "dies": "importing it ended the interpreter (exit status 7)",
    "crashes": "importing it ended the interpreter (exit status -11)",
    "exits": "SystemExit: bye",
    "shouts": "RuntimeError: in ?[31mred and two lines",
    "mute": "importing third_party_mute failed: Mute",
    "floods": "importing it ended the interpreter (exit status 3): xxx",
    "no-module": "No module named 'no_such_module'",
    "Odd?[31m name": "its name must be lower-case letters, digits and hyphens",
    "forks": None,
    "no-model": "config must be a pydantic model class, not <class 'dict'>",
    "no-opener": "No module named 'third_party_no_opener_open'",
    "prints": None,
    "fine": None,
}
SECONDS = 5.0


def breaking(line: str) -> dict[str, str]:
    """What `PluginMaker.add` replaces, so that the entry module runs `line` first."""
    return {"from pathlib": f"{line}\nfrom pathlib"}


@pytest.fixture
def installed(plugin_maker: PluginMaker) -> PluginMaker:
    plugin_maker.add("import-error", replace=breaking("import no_such_module"))
    plugin_maker.add("wrong-version", replace={"api_version=1": "api_version=99"})
    plugin_maker.add("too-old", replace={"api_version=1": "api_version=0"})
    plugin_maker.add("clash", distribution="clash-one")
    plugin_maker.add("clash", distribution="clash-two")
    plugin_maker.add("exits", replace=breaking("import sys; sys.exit('bye')"))
    plugin_maker.add("no-model", replace={"config=Config": "config=dict"})
    plugin_maker.add("prints", replace=breaking("import os; print('noise'); os.write(1, b'noise')"))
    plugin_maker.add("fine")
    return plugin_maker


def ndf(*arguments: str) -> subprocess.CompletedProcess[str]:
    code = "import sys; from ndf_core.cli import main; sys.exit(main())"
    return subprocess.run([sys.executable, "-P", "-c", code, *arguments], capture_output=True, text=True, timeout=120)


def by_name(done: subprocess.CompletedProcess[str]) -> dict[str, dict[str, Any]]:
    assert done.returncode == 0, done.stderr
    return {state["name"]: state for state in json.loads(done.stdout)}


def test_check_explains_each_in_one_line_even_a_hang_and_a_crash(
    installed: PluginMaker, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    installed.add("hangs", replace=breaking("import time; time.sleep(600)"))
    installed.add("dies", replace=breaking("import os; os._exit(7)"))
    installed.add("crashes", replace=breaking("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"))
    installed.add("floods", replace=breaking("import os; os.write(2, b'x' * 10**7); os._exit(3)"))
    installed.add("forks", replace=breaking("import subprocess; subprocess.Popen(['sleep', '30'])"))
    installed.add("shouts", replace=breaking("raise RuntimeError('in \\x1b[31mred\\nand two lines')"))
    silent = "class Mute(Exception):\n    def __str__(self):\n        return 1 / 0\nraise Mute"
    installed.add("mute", replace=breaking(silent))
    for name, entry in {
        "no-module": "no-module = no_such_module",
        "odd": "Odd\x1b[31m name = third_party_odd",
    }.items():
        installed.add(name)
        (info,) = installed.folder.glob(f"third_party_{name.replace('-', '_')}-*")
        (info / "entry_points.txt").write_text(f"[ndf.representations]\n{entry}\n")
    installed.add("no-opener")
    (installed.folder / "third_party_no_opener_open.py").unlink()
    entries.cache_clear()
    ours = [entry for entry in entries() if not entry.distribution.startswith("ndf-plugin-")]
    monkeypatch.setattr(checking, "entries", lambda _group: ours)  # ndf's own would take half a minute
    assert main(["plugins", "--check", "--timeout", str(SECONDS), "--json"]) == 0
    states = {state["name"]: state for state in json.loads(capfd.readouterr().out)}
    for name, cause in CAUSES.items():
        error = states[name]["error"]
        assert states[name]["distribution"] == f"third-party-{name.partition('?')[0].lower()}"
        assert states[name]["version"] == "1.0"
        if cause is None and error is None:
            assert states[name]["status"] == "ok"
        elif cause is None:  # torch, which the opener imports, may take longer than this test allows
            assert "did not finish" in error
        else:
            assert states[name]["status"] == "broken"
            assert cause in error, name
            assert error.isprintable()
            assert len(error) < 400
    assert states["clash"]["error"].startswith("the name clashes with clash-")


def test_help_imports_no_plugin_and_looking_at_a_file_survives_all_of_them(
    installed: PluginMaker, tmp_path: Path
) -> None:
    installed.add("dies", replace=breaking("import os; os._exit(7)"))
    assert ndf("fit", "--help").stdout.startswith("Usage: ndf fit")
    (tmp_path / "x.blob").write_text("fine, but bad")
    done = ndf("fit", str(tmp_path / "x.blob"), "-o", str(tmp_path / "x.ndf"))
    assert done.returncode == 3, done.stderr
    assert "not asked: --repr dies: the plugin third-party-dies 1.0 cannot be used: importing it ended" in done.stderr
    assert "read as fine: starts with the word fine" in done.stderr
    assert done.stderr.splitlines()[-1] == f"error: {tmp_path / 'x.blob'}: is bad"


def test_listing_and_the_other_commands_work_beside_them(installed: PluginMaker, tmp_path: Path) -> None:
    states = by_name(ndf("plugins", "--json"))
    assert states["fine"] == {
        "name": "fine",
        "distribution": "third-party-fine",
        "version": "1.0",
        "status": "listed",
        "error": None,
    }
    text = ndf("plugins")
    assert text.returncode == 0
    assert len([line for line in text.stdout.splitlines() if line.startswith("clash ")]) == 2
    assert ndf("fit", "--repr", "fine", "--help").returncode == 0
    assert ndf("fit", "--help").returncode == 0
    for command in (["info"], ["extract", "-o", str(tmp_path / "x.ply")]):
        done = ndf(*command, str(tmp_path / "none.ndf"))
        assert done.returncode == 3
        assert "none.ndf" in done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["import-error", "wrong-version", "clash", "exits", "no-model"])
def test_only_asking_for_it_is_an_error(installed: PluginMaker, name: str) -> None:
    done = ndf("fit", "x", "--repr", name, "-o", "x.ndf")
    assert done.returncode == 3
    assert done.stderr.startswith(f"error: --repr {name}: the plugin ")
    assert len(done.stderr.splitlines()) == 1


def test_what_plugins_print_stays_out_of_the_answer(installed: PluginMaker) -> None:
    done = ndf("plugins", "--schema", "prints", "--json")
    assert json.loads(done.stdout)["properties"]["repr"]["const"] == "prints"
