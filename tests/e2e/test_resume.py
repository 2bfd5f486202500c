"""Fits that are killed, over and over, end with the bytes of the fit that was left alone."""

from __future__ import annotations

import contextlib
import json
import os
import random
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pytest
from small_assets import torus

from ndf_core.asset.asset import Asset
from ndf_core.fitting.checkpoint import read_checkpoint
from ndf_core.meshio import write_mesh

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="kills forked processes; this system has none"),
]

KILLS = 20
OPTIONS = shlex.split(
    "--repr mesh --faces 100 --steps 400 --batch 300 --seed 3 --threads 2 --hidden-width 16 --encoding-levels 3 "
    "--feature-dim 4 --resample-every 2 --checkpoint-seconds 0.05"
)
PATIENCE = 120.0
"""Seconds after which something hangs, however busy the machine."""

LAUNCHER = """
import functools, json, os, sys
import ndf_core.cli.fit, ndf_plugin_sdf.mesh_surface
from ndf_core.cli import main
from ndf_core.fitting import measure, pipeline, quantise

quantise._SAMPLES = quantise._PROBE_SAMPLES = 2000
measure.dense_map.__defaults__ = (10_000,)
pipeline.measure = functools.partial(measure.measure, samples=5000)

print("ready", flush=True)
for line in sys.stdin:
    arguments, log = json.loads(line)
    child = os.fork()
    if child == 0:
        for stream in (1, 2):
            os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), stream)
        os._exit(main(arguments))
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
"""Forks a process per run, with the imports done: else most kills would hit the import of torch. Training is the
subject; quantising and measuring take fewer samples."""


@dataclass
class Life:
    """One process of `ndf fit` made by the launcher."""

    pid: int
    answers: IO[str]

    def end(self) -> int:
        """Exit code, or minus the signal."""
        return int(self.answers.readline())


class Launcher:
    def __init__(self, folder: Path) -> None:
        self._log = folder / "log.txt"
        self._process = subprocess.Popen(
            [sys.executable, "-c", LAUNCHER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def start(self, arguments: list[str]) -> Life:
        assert self._process.stdin is not None and self._process.stdout is not None
        print(json.dumps([arguments, str(self._log)]), file=self._process.stdin, flush=True)
        return Life(int(self._process.stdout.readline()), self._process.stdout)

    def run(self, arguments: list[str]) -> None:
        code = self.start(arguments).end()
        assert code == 0, self._log.read_text()

    def stop(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(PATIENCE)


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that the plugin reads: a torus."""
    path = tmp_path_factory.mktemp("input") / "torus.obj"
    write_mesh(path, *torus(24, 12))
    return path


@pytest.fixture(scope="module")
def launcher(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Launcher]:
    made = Launcher(tmp_path_factory.mktemp("log"))
    yield made
    made.stop()


@dataclass
class Whole:
    """The run that was left alone."""

    data: bytes
    seconds: float


@pytest.fixture(scope="module")
def whole(launcher: Launcher, mesh: Path, tmp_path_factory: pytest.TempPathFactory) -> Whole:
    output = tmp_path_factory.mktemp("whole") / "torus.ndf"
    start = time.monotonic()
    launcher.run(arguments(mesh, output))
    seconds = time.monotonic() - start
    assert [file.name for file in output.parent.iterdir()] == [output.name]
    return Whole(output.read_bytes(), seconds)


def arguments(mesh: Path, output: Path, *more: str) -> list[str]:
    return ["fit", str(mesh), "-o", str(output), *OPTIONS, "--quiet", *more]


def check_files(folder: Path) -> int:
    """Every file is one that can be read; the step of the checkpoint, -1 without one."""
    step = -1
    for file in folder.iterdir():
        if file.suffix == ".ndf":
            Asset.load(file)
            continue
        # Replacing a file takes two calls of the system (see `atomic_write`); killed between them, a second name of
        # the whole new file remains.
        assert file.suffix == ".checkpoint" or file.name.startswith(".ndf-"), file.name
        data = file.read_bytes()
        header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"]
        tensors = read_checkpoint(file, json.loads(header["identity"]))
        step = int(tensors["counts"][0])
    return step


def test_killed_at_random_moments(launcher: Launcher, mesh: Path, whole: Whole, tmp_path: Path) -> None:
    """SIGKILL, twenty times; a run that comes to its end before its time starts over."""
    rng = random.Random(1)
    output = tmp_path / "torus.ndf"
    steps: list[int] = []
    ends = 0
    while len(steps) < KILLS:
        life = launcher.start(arguments(mesh, output, "--resume"))
        time.sleep(rng.uniform(0.02, 0.3) * whole.seconds)
        with contextlib.suppress(ProcessLookupError):
            os.kill(life.pid, signal.SIGKILL)
        if life.end() == -signal.SIGKILL:
            steps.append(check_files(tmp_path))
        else:
            ends += 1
            assert output.read_bytes() == whole.data
            output.unlink()
    launcher.run(arguments(mesh, output, "--resume"))
    assert output.read_bytes() == whole.data
    assert not (tmp_path / "torus.ndf.checkpoint").exists()
    assert any(0 < step < 400 for step in steps), f"no kill was of use: {steps}, {ends} times at the end before it"


def test_interrupted_by_hand(mesh: Path, launcher: Launcher, whole: Whole, tmp_path: Path) -> None:
    """SIGINT: exit code 130, the command to go on with, and a checkpoint that it goes on from."""
    output = tmp_path / "torus.ndf"
    command = [sys.executable, "-m", "ndf_core", *arguments(mesh, output)]
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        # A shell may start background jobs, us among them, with SIGINT ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    deadline = time.monotonic() + PATIENCE
    checkpoint = tmp_path / "torus.ndf.checkpoint"
    while not checkpoint.exists():
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.005)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert out == "" and "Traceback" not in err
    assert [file.name for file in tmp_path.iterdir()] == [checkpoint.name]
    assert check_files(tmp_path) > 0
    resume = err.splitlines()[-1].split("go on with: ndf ")[1]
    assert shlex.split(resume) == [*arguments(mesh, output), "--resume"]
    launcher.run(shlex.split(resume))
    assert output.read_bytes() == whole.data
    assert [file.name for file in tmp_path.iterdir()] == [output.name]
