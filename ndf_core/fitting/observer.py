"""What a fit tells while it runs."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


@runtime_checkable
class Observer(Protocol):
    """Receives the progress of a fit. Every method is called from the thread that runs the fit."""

    def stage(self, name: str) -> None:
        """A stage begins: "base mesh", "initialise", "train", "quantise", "measure", "write"."""
        ...

    def progress(
        self,
        step: int,
        total: int,
        projection_rms: float,
        cycle_loss: float,
        samples_per_second: float,
        seconds_left: float,
    ) -> None:
        """About twice a second while training; `projection_rms` in the box frame, `cycle_loss` as in Sec. 3.2."""
        ...

    def message(self, text: str) -> None:
        """One line for the user."""
        ...


class Silent:
    """Says nothing."""

    def stage(self, name: str) -> None: ...

    def progress(
        self,
        step: int,
        total: int,
        projection_rms: float,
        cycle_loss: float,
        samples_per_second: float,
        seconds_left: float,
    ) -> None: ...

    def message(self, text: str) -> None: ...
