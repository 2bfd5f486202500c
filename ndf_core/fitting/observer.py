"""What a fit tells while it runs."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

from ndf_core.lines import one_line


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
    """Receives the progress of a fit. Every method is called from the thread that runs the fit.

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
    fit."""

    def __init__(self, observers: Iterable[Observer] = ()) -> None:
        self._observers = list(observers)

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
            try:
                getattr(observer, event)(value)
            except (Exception, SystemExit) as error:
                self._observers.remove(observer)
                self._report(f"the observer {type(observer).__name__} failed and is left out: {one_line(error)}")

    def _report(self, text: str) -> None:
        if self._observers:
            self.message(text)
        else:
            print(text, file=sys.stderr)
