"""What a light command imports and costs. Each runs in an interpreter of its own."""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.conftest import PluginMaker

HEAVY = {"numpy", "torch", "scipy", "pydantic", "pluggy", "rich", "trimesh", "igl", "open3d", "DracoPy", "jaxtyping"}


def modules_after(*arguments: str) -> set[str]:
    """Top-level modules loaded once the command is done."""
    code = (
        "import sys, atexit\n"
        "atexit.register(lambda: print('MODULES', *sys.modules, file=sys.stderr))\n"
        "from ndf_core.cli import main\n"
        f"sys.exit(main({list(arguments)!r}))"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    return set(done.stderr.rpartition("MODULES ")[2].split())


def test_help_imports_nothing_heavy() -> None:
    loaded = modules_after("--help")
    assert not loaded & HEAVY
    assert "importlib.metadata" not in loaded


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = "import sys, ndf_core; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True).stdout
    assert not set(loaded.split()) & HEAVY


def test_listing_plugins_imports_no_plugin(plugin_maker: PluginMaker) -> None:
    module = plugin_maker.add("blob")
    loaded = modules_after("plugins", "--json")
    assert not [name for name in loaded if name == module or name.startswith("ndf_plugin_")]
    assert not loaded & HEAVY


def cpu_seconds(code: str) -> float:
    """Of a new interpreter that runs `code`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-P", "-c", code], stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def test_help_takes_less_than_100_ms_of_cpu() -> None:
    """The least of several runs, since others may be using the machine."""
    least = math.inf
    for _ in range(20):
        least = min(least, cpu_seconds("import sys; from ndf_core.cli import main; sys.exit(main(['--help']))"))
        if least < 0.1:
            break
    assert least < 0.1


def test_a_reader_that_goes_away_is_no_traceback(tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    code = "import sys; from ndf_core.cli import main; sys.exit(main(['plugins', '--json']))"
    done = subprocess.run([sys.executable, "-P", "-c", code], stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert done.returncode == 1
    assert done.stderr == ""
