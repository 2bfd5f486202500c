"""What a fit tells while it runs."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable


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

    def stage(self, name: str) -> None:
        """A stage begins: "base mesh", "initialise", "train", "quantise", "measure", "write"."""

    def progress(self, progress: TrainingProgress) -> None:
        """About twice a second while training, and at its end."""

    def message(self, text: str) -> None:
        """One line for the user."""


class Silent(Observer):
    """Says nothing."""
