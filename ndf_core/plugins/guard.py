"""Calls into foreign code that must not hurt: bounded in time, silent on stdout, every failure one line."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from threading import Thread
from typing import Generic, TypeVar

from ndf_core.errors import NdfError
from ndf_core.lines import one_line, plain_line

T = TypeVar("T")

SECONDS = 20.0
"""How long a light entry module may take; a slow disk included."""


class ForeignFailure(Exception):
    """Foreign code raised, hung, or left the interpreter; the message is one line."""


@dataclass
class _Outcome(Generic[T]):
    value: T | None = None
    error: BaseException | None = None


def guarded(call: Callable[[], T], what: str, seconds: float | None = SECONDS) -> T:
    """Run `call` and return its answer; what it prints goes to stderr.

    With a time limit it runs in a thread that is abandoned when time is up: Python cannot stop it, but the caller
    goes on. Without one it runs here.

    Raises:
        ForeignFailure: it raised anything but KeyboardInterrupt, or did not finish.
    """
    outcome = _Outcome[T]()

    def work() -> None:
        try:
            outcome.value = call()
        except BaseException as error:
            outcome.error = error

    with redirect_stdout(sys.stderr), redirect_stderr(sys.stderr):  # both are put back, whatever it made of them
        if seconds is None:
            work()
        else:
            thread = Thread(target=work, daemon=True, name=f"ndf: {what}")
            thread.start()
            thread.join(seconds)
            if thread.is_alive():
                raise ForeignFailure(f"{what} did not finish within {seconds:g} s")
    if isinstance(outcome.error, KeyboardInterrupt):
        raise outcome.error
    if isinstance(outcome.error, NdfError):  # says all that there is to say
        raise ForeignFailure(plain_line(str(outcome.error))) from outcome.error
    if outcome.error is not None:
        raise ForeignFailure(f"{what} failed: {one_line(outcome.error)}") from outcome.error
    return outcome.value  # pyright: ignore[reportReturnType]  # set when there is no error
