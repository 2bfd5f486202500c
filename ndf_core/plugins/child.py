"""A module of ndf in a process of its own, where foreign code may crash, hang, or print without end."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from threading import Thread
from typing import IO, NamedTuple

from ndf_core.lines import plain_line

_KEPT = 1 << 18
"""Bytes of each stream that are kept, the last ones."""
_GRACE = 2.0
"""Seconds for what is still in the pipes when the process is gone; a grandchild may hold them for ever."""


class Ended(NamedTuple):
    """What is left of the process."""

    status: int | None
    """Exit status; None where it was killed because time was up."""
    output: bytes
    last: str
    """What it wrote last on stderr, on one line."""

    @property
    def cause(self) -> str:
        """Status and last words, for messages."""
        return f"(exit status {self.status}){': ' + self.last if self.last else ''}"


def run_child(module: str, arguments: Sequence[str], seconds: float) -> Ended:
    """Run ``python -m module`` with empty stdin. ``-P``: what lies in the working directory is nobody's plugin."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", module, *arguments],
        bufsize=0,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None and process.stderr is not None
    output, errors = _Tail(process.stdout), _Tail(process.stderr)
    try:
        status = process.wait(seconds)
    except subprocess.TimeoutExpired:
        status = None
    finally:
        process.kill()
        process.wait()
    output.join(_GRACE)
    errors.join(_GRACE)
    last = errors.kept.decode(errors="replace").strip().rpartition("\n")[2]
    return Ended(status, output.kept, plain_line(last))


class _Tail(Thread):
    """Reads a stream to its end and keeps the end."""

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(daemon=True, name="ndf: output of a plugin's process")
        self.kept = b""
        self._stream = stream
        self.start()

    def run(self) -> None:
        with self._stream as stream:
            while part := stream.read(1 << 16):
                self.kept = (self.kept + part)[-_KEPT:]
