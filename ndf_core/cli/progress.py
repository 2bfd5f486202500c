"""What `ndf fit` shows on stderr while it works: a live line in a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ndf_core.fitting.observer import Observer

if TYPE_CHECKING:
    from ndf_core.fitting.observer import TrainingProgress

PLAIN_SECONDS = 5.0
"""Between two plain lines."""


@contextmanager
def make_observer(quiet: bool) -> Generator[Observer | None]:
    """The observer that suits stderr; None when nothing is to be shown."""
    if quiet:
        yield None
    elif sys.stderr.isatty():
        from ndf_core.cli.live import live_observer

        with live_observer() as observer:
            yield observer
    else:
        yield PlainObserver()


class PlainObserver(Observer):
    """One line per stage, and one every few seconds of training: fit for a log file."""

    def __init__(self, seconds: float = PLAIN_SECONDS) -> None:
        self._seconds = seconds
        self._last = -float("inf")

    def stage(self, name: str) -> None:
        self._last = -float("inf")
        print(f"{name} ...", file=sys.stderr, flush=True)

    def progress(self, progress: TrainingProgress) -> None:
        now = time.monotonic()
        if now - self._last >= self._seconds or progress.step == progress.total:
            self._last = now
            print(f"  {progress_line(progress)}", file=sys.stderr, flush=True)

    def message(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)


def progress_line(progress: TrainingProgress) -> str:
    """Both losses, samples per second and time left."""
    step, total, projection_rms, cycle_loss, samples_per_second, seconds_left = progress
    width = len(str(total))
    return (
        f"step {step:>{width}}/{total}  projection rms {projection_rms:.2e}  cycle {cycle_loss:.2e}  "
        f"{samples_per_second / 1e3:,.0f}k samples/s  {clock(seconds_left)} left"
    )


def clock(seconds: float) -> str:
    """Seconds as 7 s, 2:05 or 1:02:05."""
    if not seconds < 1e7:  # also not a number
        return "?"
    whole = max(0, round(seconds))
    minutes, rest = divmod(whole, 60)
    if minutes == 0:
        return f"{rest} s"
    return f"{minutes}:{rest:02}" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02}:{rest:02}"
