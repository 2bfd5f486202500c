"""What stderr shows while a fit runs."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from ndf_core.cli.progress import PlainObserver, clock, make_observer
from ndf_core.fitting.observer import TrainingProgress


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0 s"), (59.4, "59 s"), (60, "1:00"), (125, "2:05"), (3725, "1:02:05"), (-3, "0 s"), (float("nan"), "?"),
     (float("inf"), "?")],
)  # fmt: skip
def test_time_left_reads_like_a_clock(seconds: float, text: str) -> None:
    assert clock(seconds) == text


def test_a_log_file_gets_a_line_now_and_then_and_the_last_one(capsys: pytest.CaptureFixture[str]) -> None:
    observer = PlainObserver(seconds=60)
    observer.stage("train")
    for step in range(1, 101):
        observer.progress(TrainingProgress(step, 100, 1e-4, 1e-6, 1e5, 1.0))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "train ..."
    assert [line.split()[1] for line in lines[1:]] == ["1/100", "100/100"]


def test_quiet_has_no_observer() -> None:
    with make_observer(quiet=True) as observer:
        assert observer is None


def test_a_terminal_gets_a_live_line_and_messages_above_it() -> None:
    code = (
        "from ndf_core.cli.progress import make_observer\n"
        "from ndf_core.fitting.observer import TrainingProgress\n"
        "with make_observer(quiet=False) as observer:\n"
        "    observer.stage('train')\n"
        "    observer.progress(TrainingProgress(300, 1500, 1.25e-4, 3.1e-6, 123456.0, 125.0))\n"
        "    observer.message('a [bold] message')\n"
        "print('answer')\n"
    )
    master, slave = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "150"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], stdout=subprocess.PIPE, stderr=slave, env=environment, text=True
    )
    os.close(slave)
    shown = os.read(master, 1 << 16).decode()
    os.close(master)
    assert done.stdout == "answer\n"
    assert "a [bold] message" in shown
    assert "300/1500" in shown
    assert "2:05 left" in shown
