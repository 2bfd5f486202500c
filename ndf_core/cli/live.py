"""The live line of `ndf fit` in a terminal. rich comes with ``ndf-core[fit]``, which this command needs anyway."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from ndf_core.cli.progress import progress_line
from ndf_core.fitting.observer import Observer

if TYPE_CHECKING:
    from ndf_core.fitting.observer import TrainingProgress


@contextmanager
def live_observer() -> Generator[LiveObserver]:
    """Keeps one line at the bottom of the terminal up to date; messages scroll above it."""
    console = Console(stderr=True)
    with Live(console=console, refresh_per_second=8, transient=True) as live:
        yield LiveObserver(console, live)


class LiveObserver(Observer):
    """Shows the stage, or in training a bar and the losses."""

    def __init__(self, console: Console, live: Live) -> None:
        self._console = console
        self._live = live

    def stage(self, name: str) -> None:
        self._live.update(Text(f"{name} ..."))

    def progress(self, progress: TrainingProgress) -> None:
        row = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=max(progress.total, 1), completed=progress.step, width=20)
        row.add_row(bar, Text(progress_line(progress), no_wrap=True))
        self._live.update(row)

    def message(self, text: str) -> None:
        self._console.print(Text(text))
