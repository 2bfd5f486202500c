"""``--observe tensorboard:FOLDER``: losses and speed as scalars (``pip install 'ndf-core[tensorboard]'``)."""

from __future__ import annotations

from ndf_core.api import ObserverSpec, hookimpl


@hookimpl
def ndf_observer() -> ObserverSpec:
    """Offer `tensorboard`."""
    return ObserverSpec(
        name="tensorboard",
        summary="TensorBoard scalars; TARGET is the log folder, runs if left out",
        open="ndf_core.observers.tensorboard_log:TensorBoard",
        api_version=1,
    )
