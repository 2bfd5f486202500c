"""A plugin's observer in a thread of its own, so that one that hangs costs a fit a minute or two and no more."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from queue import SimpleQueue
from threading import Thread
from typing import Any

from ndf_core.fitting.observer import Observer, TrainingProgress

CALL_SECONDS = 120.0
"""For one call: a logger may wait for its server when it starts and when it ends."""

_Call = Callable[[], Any]


class InThread(Observer):
    """Made and called in one thread, as a logger with a database connection needs. The fit waits for each call, so
    events arrive in order and none piles up; a call that does not return is given up with its thread.

    Raises:
        TimeoutError: from the call that does not return, and at once from any after it.
    """

    def __init__(self, title: str, make: Callable[[], Observer], seconds: float = CALL_SECONDS) -> None:
        self.title = title
        self._seconds = seconds
        self._calls: SimpleQueue[tuple[_Call, Future[Any]]] = SimpleQueue()
        self._last: Future[Any] | None = None
        Thread(target=self._serve, daemon=True, name=f"ndf: observer {title}").start()
        self._observer: Observer = self._call(make, "opening it")

    def start(self, run: Mapping[str, Any]) -> None:
        self._call(lambda: self._observer.start(run), "start")

    def stage(self, name: str) -> None:
        self._call(lambda: self._observer.stage(name), "stage")

    def progress(self, progress: TrainingProgress) -> None:
        self._call(lambda: self._observer.progress(progress), "progress")

    def message(self, text: str) -> None:
        self._call(lambda: self._observer.message(text), "message")

    def finish(self, report: Mapping[str, Any] | None) -> None:
        self._call(lambda: self._observer.finish(report), "finish")

    def _call(self, call: _Call, what: str) -> Any:
        if self._last is not None and not self._last.done():  # an interrupt came while the fit waited for it
            raise TimeoutError("an earlier call has not returned")
        self._last = Future()
        self._calls.put((call, self._last))
        try:
            return self._last.result(self._seconds)
        except TimeoutError:
            if self._last.done():
                raise  # its own
            raise TimeoutError(f"{what} did not return within {self._seconds:g} s") from None

    def _serve(self) -> None:
        while True:
            call, answer = self._calls.get()
            try:
                answer.set_result(call())
            except BaseException as error:
                answer.set_exception(error)
