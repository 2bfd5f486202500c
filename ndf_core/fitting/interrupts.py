"""Keep Ctrl-C from tearing a training step apart."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager
from types import FrameType


class Interrupts:
    """Whether Ctrl-C was pressed."""

    def __init__(self) -> None:
        self.came = False

    def handle(self, number: int, frame: FrameType | None) -> None:
        """What Python calls on SIGINT."""
        if self.came:
            raise KeyboardInterrupt
        self.came = True


@contextmanager
def held_interrupts() -> Generator[Interrupts]:
    """Note the first SIGINT instead of raising `KeyboardInterrupt`; the second raises at once.

    Python raises between any two bytecodes, so between the halves of an update too: parameters that have moved with
    moments that have not. Nothing is held outside the main thread, which alone gets signals, nor where the program
    has its own idea of SIGINT (a handler, or ignoring it under nohup).
    """
    interrupts = Interrupts()
    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if ours:
        signal.signal(signal.SIGINT, interrupts.handle)
    try:
        yield interrupts
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
