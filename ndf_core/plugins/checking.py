"""The state of every plugin, each examined in a process of its own: a crash or a hang there is a line here."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from typing import Literal

from ndf_core.plugins.child import run_child
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
    causes = probe(entries(group), "all", seconds, at_once=2)
    return [_status(entry, "ok", cause) for entry, cause in zip(entries(group), causes, strict=True)]


def probe(claims: Sequence[Entry], what: Literal["light", "all"], seconds: float, at_once: int) -> list[str | None]:
    """Causes of failure, None where all is well.

    Args:
        claims: whose plugins to import.
        what: "light" stops after the entry module, "all" goes on to what does the work.
        seconds: for each.
        at_once: how many processes.
    """
    with ThreadPoolExecutor(at_once) as pool:
        return list(pool.map(_probe, claims, repeat(what), repeat(seconds)))


def _status(entry: Entry, good: Literal["listed", "ok"], error: str | None) -> Status:
    return Status(entry.name, entry.distribution, entry.version, "broken" if error else good, error)


def _probe(entry: Entry, what: str, seconds: float) -> str | None:
    if entry.error:
        return entry.error
    words = [entry.group, entry.name, entry.distribution, what, str(seconds)]
    done = run_child("ndf_core.plugins.probe", words, seconds + 5)
    if done.status is None:
        return f"importing it did not finish within {seconds:g} s"
    try:
        answer = json.loads(done.output)
        return None if answer["cause"] is None else str(answer["cause"])
    except (ValueError, KeyError, TypeError):
        return f"importing it ended the interpreter {done.cause}"
