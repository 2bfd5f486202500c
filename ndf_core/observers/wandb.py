"""``--observe wandb:PROJECT``: a run of Weights & Biases (``pip install 'ndf-core[wandb]'``)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ndf_core.api import ObserverSpec, hookimpl
from ndf_core.errors import PluginError
from ndf_core.fitting.observer import Observer, TrainingProgress

DEFAULT = "ndf"


@hookimpl
def ndf_observer() -> ObserverSpec:
    """Offer `wandb`."""
    return ObserverSpec(
        name="wandb",
        summary=f"Weights & Biases; TARGET is the project, {DEFAULT} if left out",
        open="ndf_core.observers.wandb:open_wandb",
        api_version=1,
    )


def open_wandb(target: str | None) -> WandB:
    """Prepare a run; it begins with the fit. WANDB_MODE=offline keeps everything on this machine.

    Raises:
        PluginError: wandb is not installed.
    """
    try:
        import wandb  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise PluginError("--observe wandb needs Weights & Biases: pip install 'ndf-core[wandb]'") from error
    return WandB(wandb, target or DEFAULT)


class WandB(Observer):
    """Losses over steps; the fit's options as config, its report as summary."""

    def __init__(self, wandb: Any, project: str) -> None:
        self._wandb, self._project, self._run = wandb, project, None

    def start(self, run: Mapping[str, Any]) -> None:
        self._run: Any = self._wandb.init(project=self._project, config=dict(run))

    def progress(self, progress: TrainingProgress) -> None:
        names = ("projection_rms", "cycle_loss", "samples_per_second")
        self._run.log({name: getattr(progress, name) for name in names}, step=progress.step)

    def finish(self, report: Mapping[str, Any] | None) -> None:
        self._run.summary.update(report or {})
        self._run.finish(exit_code=0 if report else 1)
