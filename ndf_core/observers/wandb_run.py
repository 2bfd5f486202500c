"""What `wandb` opens; cannot be imported without Weights & Biases."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ndf_core.errors import PluginError
from ndf_core.fitting.observer import Observer, TrainingProgress

try:
    from wandb import init  # pyright: ignore[reportAttributeAccessIssue]  # an extra; takes the file beside for it
except ImportError as error:
    raise PluginError("Weights & Biases is not installed: pip install 'ndf-core[wandb]'") from error


class WandB(Observer):
    """Losses over steps; the fit's options as config, its report as summary. The run begins with the fit;
    WANDB_MODE=offline keeps everything on this machine."""

    def __init__(self, target: str | None) -> None:
        self._project = target or "ndf"
        self._run: Any = None

    def start(self, run: Mapping[str, Any]) -> None:
        self._run = init(project=self._project, config=dict(run))

    def progress(self, progress: TrainingProgress) -> None:
        names = ("projection_rms", "cycle_loss", "samples_per_second")
        self._run.log({name: getattr(progress, name) for name in names}, step=progress.step)

    def finish(self, report: Mapping[str, Any] | None) -> None:
        self._run.summary.update(report or {})
        self._run.finish(exit_code=0 if report else 1)
