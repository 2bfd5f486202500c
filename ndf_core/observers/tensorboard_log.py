"""What `tensorboard` opens; cannot be imported without TensorBoard."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ndf_core.errors import PluginError
from ndf_core.fitting.observer import Observer, TrainingProgress
from ndf_core.plain_json import as_json

try:
    from torch.utils.tensorboard import SummaryWriter
except ImportError as error:
    raise PluginError("TensorBoard is not installed: pip install 'ndf-core[tensorboard]'") from error


class TensorBoard(Observer):
    """Scalars over steps; config and report as text."""

    def __init__(self, target: str | None) -> None:
        self._writer: Any = SummaryWriter(target or "runs")
        self._step = 0

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
