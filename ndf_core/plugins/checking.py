"""The state of every plugin, each examined in a process of its own: a crash or a hang there is a line here."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from typing import Literal

from ndf_core.plugins.discovery import GROUP, Entry, entries

CHECK_SECONDS = 60.0
"""Time for everything that opening a file would import, torch from a cold disk included."""


@dataclass(frozen=True)
class Status:
    """One line of ``ndf plugins``."""

    name: str
    distribution: str
    version: str
    status: Literal["listed", "ok", "broken"]
    """"listed": seen in the metadata, not tried."""
    error: str | None


def list_plugins(group: str = GROUP) -> list[Status]:
    """What metadata tell; imports nothing."""
    return [_status(entry, "listed", entry.error) for entry in entries(group)]


def check_plugins(seconds: float = CHECK_SECONDS, group: str = GROUP) -> list[Status]:
    """Import every plugin with all that it needs to do its work, two at a time, each for at most `seconds`."""
    with ThreadPoolExecutor(max_workers=2) as pool:
        causes = list(pool.map(_probe, entries(group), repeat(seconds)))
    return [_status(entry, "ok", cause) for entry, cause in zip(entries(group), causes, strict=True)]


def _status(entry: Entry, good: Literal["listed", "ok"], error: str | None) -> Status:
    return Status(entry.name, entry.distribution, entry.version, "broken" if error else good, error)


def _probe(entry: Entry, seconds: float) -> str | None:
    """Cause of failure, None where all is well. ``-P``: what lies in the working directory is nobody's plugin."""
    if entry.error:
        return entry.error
    command = [sys.executable, "-P", "-m", "ndf_core.plugins.probe"]
    command += [entry.group, entry.name, entry.distribution, str(seconds)]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=seconds + 5)
    except subprocess.TimeoutExpired:
        return f"importing it did not finish within {seconds:g} s"
    try:
        answer = json.loads(done.stdout)
        return None if answer["cause"] is None else str(answer["cause"])
    except (ValueError, KeyError, TypeError):
        last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        return f"importing it ended the interpreter (exit status {done.returncode}){': ' + last if last else ''}"
