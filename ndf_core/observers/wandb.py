"""``--observe wandb:PROJECT``: a run of Weights & Biases (``pip install 'ndf-core[wandb]'``)."""

from __future__ import annotations

from ndf_core.api import ObserverSpec, hookimpl


@hookimpl
def ndf_observer() -> ObserverSpec:
    """Offer `wandb`."""
    return ObserverSpec(
        name="wandb",
        summary="Weights & Biases; TARGET is the project, ndf if left out",
        open="ndf_core.observers.wandb_run:WandB",
        api_version=1,
    )
