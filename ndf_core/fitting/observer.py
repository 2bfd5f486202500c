"""What a fit tells while it runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

from ndf_core.lines import one_line

SLOW_SECONDS, SLOW_SHARE = 5.0, 0.05
"""An observer that took more seconds than this, and more of the time since the start, is called slow."""


class TrainingProgress(NamedTuple):
    """Where the training stands; the losses are means since the last report."""

    step: int
    total: int
    projection_rms: float
    """Box frame."""
    cycle_loss: float
    """As in Sec. 3.2, box frame."""
    samples_per_second: float
    seconds_left: float


@runtime_checkable
class Observer(Protocol):
    """Receives the progress of a fit, one call at a time; the fit waits for each. All calls come from one thread.

    A subclass need not write every method: those left out do nothing.
    """

    def start(self, run: Mapping[str, Any]) -> None:
        """The fit begins: `representation`, `input` (fingerprint), `plugin`, `output`, and `config`, its options."""

    def stage(self, name: str) -> None:
        """A stage begins: "base mesh", "initialise", "train", "quantise", "measure", "write"."""

    def progress(self, progress: TrainingProgress) -> None:
        """About twice a second while training, and at its end."""

    def message(self, text: str) -> None:
        """One line for the user."""

    def finish(self, report: Mapping[str, Any] | None) -> None:
        """The fit is over: what `ndf fit --json` prints, or None where it failed or was interrupted."""


class Silent(Observer):
    """Says nothing."""


class Observers(Observer):
    """Several at once. One that fails is reported once, to the others, and is not called again: no observer stops a
    fit. One that holds it up is reported once."""

    def __init__(self, observers: Iterable[Observer] = ()) -> None:
        self._observers = list(observers)
        self._begin = time.perf_counter()
        self._spent = {id(observer): 0.0 for observer in self._observers}  # seconds, of those not found slow yet

    @staticmethod
    def of(observer: Observer | None) -> Observers:
        """The observer under guard."""
        if isinstance(observer, Observers):
            return observer
        return Observers([] if observer is None else [observer])

    def start(self, run: Mapping[str, Any]) -> None:
        self._tell("start", run)

    def stage(self, name: str) -> None:
        self._tell("stage", name)

    def progress(self, progress: TrainingProgress) -> None:
        self._tell("progress", progress)

    def message(self, text: str) -> None:
        self._tell("message", text)

    def finish(self, report: Mapping[str, Any] | None) -> None:
        self._tell("finish", report)

    def _tell(self, event: str, value: Any) -> None:
        for observer in list(self._observers):
            before = time.perf_counter()
            try:
                getattr(observer, event)(value)
            except (Exception, SystemExit) as error:
                self._observers.remove(observer)
                self._report(f"the observer {_title(observer)} failed and is left out: {one_line(error)}")
            else:
                self._weigh(observer, time.perf_counter() - before)

    def _weigh(self, observer: Observer, seconds: float) -> None:
        if id(observer) not in self._spent:
            return
        self._spent[id(observer)] += seconds
        spent = self._spent[id(observer)]
        if spent > SLOW_SECONDS and spent > SLOW_SHARE * (time.perf_counter() - self._begin):
            del self._spent[id(observer)]
            self._report(f"the observer {_title(observer)} holds the fit up: {spent:.3g} s so far (said once)")

    def _report(self, text: str) -> None:
        if self._observers:
            self.message(text)
        else:
            print(text, file=sys.stderr)


def _title(observer: Observer) -> str:
    """The name that the user asked for, where there is one."""
    return str(getattr(observer, "title", type(observer).__name__))
