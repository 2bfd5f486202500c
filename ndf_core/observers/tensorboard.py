"""``--observe tensorboard:FOLDER``: losses and speed as scalars (``pip install 'ndf-core[tensorboard]'``)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ndf_core.api import ObserverSpec, hookimpl
from ndf_core.errors import PluginError
from ndf_core.fitting.observer import Observer, TrainingProgress
from ndf_core.plain_json import as_json

DEFAULT = "runs"


@hookimpl
def ndf_observer() -> ObserverSpec:
    """Offer `tensorboard`."""
    return ObserverSpec(
        name="tensorboard",
        summary=f"TensorBoard scalars; TARGET is the log folder, {DEFAULT} if left out",
        open="ndf_core.observers.tensorboard:open_tensorboard",
        api_version=1,
    )


def open_tensorboard(target: str | None) -> TensorBoard:
    """Begin a log.

    Raises:
        PluginError: TensorBoard is not installed.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise PluginError("--observe tensorboard needs TensorBoard: pip install 'ndf-core[tensorboard]'") from error
    return TensorBoard(SummaryWriter(target or DEFAULT))


class TensorBoard(Observer):
    """Scalars over steps; config and report as text."""

    def __init__(self, writer: Any) -> None:
        self._writer, self._step = writer, 0

    def start(self, run: Mapping[str, Any]) -> None:
        self._writer.add_text("run", as_json(run))

    def progress(self, progress: TrainingProgress) -> None:
        self._step = progress.step
        for name in ("projection_rms", "cycle_loss", "samples_per_second"):
            self._writer.add_scalar(name, getattr(progress, name), progress.step)

    def message(self, text: str) -> None:
        self._writer.add_text("messages", text, self._step)

    def finish(self, report: Mapping[str, Any] | None) -> None:
        self._writer.add_text("report", as_json(report))
        self._writer.close()
