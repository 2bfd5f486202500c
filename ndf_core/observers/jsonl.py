"""``--observe jsonl:FILE``: one JSON object per line and event, written as it happens."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

from ndf_core.api import ObserverSpec, hookimpl
from ndf_core.errors import OutputError
from ndf_core.fitting.observer import Observer, TrainingProgress
from ndf_core.plain_json import as_json

DEFAULT = "fit.jsonl"


@hookimpl
def ndf_observer() -> ObserverSpec:
    """Offer `jsonl`."""
    return ObserverSpec(
        name="jsonl",
        summary=f"JSON lines; TARGET is the file, {DEFAULT} if left out",
        open="ndf_core.observers.jsonl:open_jsonl",
        api_version=1,
    )


def open_jsonl(target: str | None) -> JsonLines:
    """Open the file, replacing one of its name.

    Raises:
        OutputError: it cannot be written.
    """
    path = Path(target or DEFAULT)
    try:
        return JsonLines(path.open("w", encoding="utf-8"))
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


class JsonLines(Observer):
    """Events `start`, `stage`, `progress`, `message`, `finish`, each with the seconds since the start."""

    def __init__(self, file: TextIO) -> None:
        self._file, self._begin = file, time.perf_counter()

    def start(self, run: Mapping[str, Any]) -> None:
        self._write("start", **run)

    def stage(self, name: str) -> None:
        self._write("stage", name=name)

    def progress(self, progress: TrainingProgress) -> None:
        self._write("progress", **progress._asdict())

    def message(self, text: str) -> None:
        self._write("message", text=text)

    def finish(self, report: Mapping[str, Any] | None) -> None:
        self._write("finish", report=report)
        self._file.close()

    def _write(self, event: str, **values: Any) -> None:
        seconds = round(time.perf_counter() - self._begin, 3)
        self._file.write(as_json({"event": event, "seconds": seconds, **values}) + "\n")
        self._file.flush()
