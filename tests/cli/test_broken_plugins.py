"""With broken third-party plugins installed everything else works, and each is explained in one line."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest

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
    "exits": "SystemExit",
    "no-model": "config must be a pydantic model class, not <class 'dict'>",
    "no-opener": "No module named 'third_party_no_opener_open'",
    "prints": None,
    "fine": None,
}


@pytest.fixture
def installed(plugin_maker: PluginMaker) -> PluginMaker:
    def breaking(line: str) -> dict[str, str]:
        return {"from pathlib": f"{line}\nfrom pathlib"}

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


def test_check_explains_each_in_one_line_even_a_hang_and_a_crash(installed: PluginMaker) -> None:
    def breaking(line: str) -> dict[str, str]:
        return {"from pathlib": f"{line}\nfrom pathlib"}

    installed.add("hangs", replace=breaking("import time; time.sleep(600)"))
    installed.add("dies", replace=breaking("import os; os._exit(7)"))
    installed.add("crashes", replace=breaking("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"))
    installed.add("no-opener")
    (installed.folder / "third_party_no_opener_open.py").unlink()
    states = by_name(ndf("plugins", "--check", "--timeout", "5", "--json"))
    for name, cause in CAUSES.items():
        error = states[name]["error"]
        assert states[name]["distribution"] == f"third-party-{name}"
        assert states[name]["version"] == "1.0"
        if cause is None and error is None:
            assert states[name]["status"] == "ok"
        elif cause is None:  # torch, which the opener imports, may take longer than this test allows
            assert "did not finish" in error
        else:
            assert states[name]["status"] == "broken"
            assert cause in error, name
            assert "\n" not in error
    assert states["clash"]["error"].startswith("the name clashes with clash-")


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
