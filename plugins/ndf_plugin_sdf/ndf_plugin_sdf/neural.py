"""``--repr neural``: the level set of a network, given by its weights or as a function."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ndf_core.api import RepresentationSpec, Sniff, hookimpl
from ndf_plugin_sdf.defaults import API_VERSION, COSTLY_TRAINING_DEFAULTS
from ndf_plugin_sdf.networks.description import NetworkDescription
from ndf_plugin_sdf.networks.formats import SUFFIXES, look
from ndf_plugin_sdf.networks.likeness import is_point_network, is_radiance

Finite = Annotated[float, Field(allow_inf_nan=False)]
Corner = tuple[Finite, Finite, Finite]


class NeuralConfig(BaseModel):
    """Options of `neural`. Lengths are in the units of the network's input."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    network: NetworkDescription = Field(
        default_factory=lambda: NetworkDescription(), description="what the weights do not say about the network"
    )
    description: str | None = Field(
        default=None,
        description="TOML or JSON file with the fields of `network`; none: a file of the input's name with the "
        "suffix .toml or .json, if there is one",
    )
    bounds: tuple[Corner, Corner] | None = Field(
        default=None,
        description="box that the network knows; what its level set does outside is ignored, and where it reaches "
        "the box it is capped; none: [[-1, -1, -1], [1, 1, 1]]",
    )
    iso: Finite | None = Field(default=None, description="value at the surface; none: 0, or 0.5 after a sigmoid")
    inside: Literal["auto", "below", "above"] = Field(
        default="auto",
        description="side of the iso value that is inside; auto: the side that most of the box's border is not",
    )
    resolution: int = Field(
        default=256, ge=16, le=1024, description="cells of the base mesh's grid along the longest side"
    )
    corrections: int = Field(
        default=2, ge=0, le=20, description="most steps from a projection towards the closest point"
    )
    trust_program: bool = Field(
        default=False, description="load an exported program (.pt2): loading it can run any code that is in it"
    )

    @model_validator(mode="after")
    def _is_box(self) -> NeuralConfig:
        if self.bounds is not None and not all(low < high for low, high in zip(*self.bounds, strict=True)):
            raise ValueError("bounds: each coordinate of the first corner must be below that of the second")
        return self


@hookimpl
def ndf_representation() -> RepresentationSpec:
    """Offer `neural`."""
    return RepresentationSpec(
        name="neural",
        summary="a neural implicit: weights of an MLP (.npz .safetensors .h5 .ckpt .pt2), NeuS, or module:callable",
        config=NeuralConfig,
        open="ndf_plugin_sdf.neural_surface:open_neural",
        api_version=API_VERSION,
        support="full",
        training_defaults=COSTLY_TRAINING_DEFAULTS,
        suffixes=SUFFIXES,
        sniff=sniff,
    )


def sniff(path: Path) -> Sniff | None:
    """Weights of a chain of layers that begins with a point; only the suffix where the file has to be opened."""
    if not path.is_file():
        return None
    found = look(path)
    if found is None:
        return Sniff(0.3, f"only by its suffix, {path.suffix}") if path.suffix.lower() in SUFFIXES else None
    if found.format in ("hdf5", "program"):
        return Sniff(0.6, f"network ({found.format})")
    if any("weight" in name for name in found.names):
        return None if is_radiance(found.names) else Sniff(0.6, "checkpoint of a network")
    if found.shapes is None:
        return Sniff(0.3, f"a file that can hold a network's weights ({found.format})")
    return Sniff(0.6, f"weights of a network of points ({found.format})") if is_point_network(found.shapes) else None
