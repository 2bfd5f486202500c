"""What weights alone do not say about a network, as options; no numpy, no torch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

ActivationName = Literal["relu", "leaky_relu", "elu", "softplus", "sine", "tanh"]
Preset = Literal["neus", "sdfstudio", "nerfstudio", "deepsdf", "siren"]


class NetworkDescription(BaseModel):
    """A multilayer perceptron of a point. What is left at `none` is found from the weights and their names."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    preset: Preset | None = Field(
        default=None, description="a known architecture; the options below that are given change it"
    )
    prefix: str | None = Field(
        default=None, description="take only the arrays whose names begin so, where a file holds several networks"
    )
    activation: ActivationName | None = Field(
        default=None, description="of every layer but the last; where names do not say: relu"
    )
    beta: float = Field(default=1.0, gt=0, le=1e6, description="softplus: log(1 + exp(beta x)) / beta")
    omega: float = Field(default=30.0, gt=0, le=1e4, description="sine: sin(omega x)")
    first_omega: float | None = Field(
        default=None, gt=0, le=1e4, description="sine: omega of the first layer; none: omega"
    )
    slope: float = Field(default=0.01, ge=0, le=1, description="leaky_relu: slope of the negative part")
    output: Literal["none", "tanh", "sigmoid"] = Field(
        default="none", description="function after the last layer; it decides what the iso value means"
    )
    output_column: int = Field(default=0, ge=0, le=4095, description="which output is phi, where there are several")
    skip_order: Literal["hidden_first", "input_first"] = Field(
        default="hidden_first", description="order of the two parts of a skip connection's input"
    )
    skip_scale: float = Field(
        default=1.0, gt=0, le=1, description="factor on the input of a layer with a skip connection; NeuS: 0.7071"
    )
    frequencies: int | None = Field(
        default=None,
        ge=0,
        le=32,
        description="octaves of the positional encoding; none: as the first layer's width says",
    )
    base_frequency: float = Field(
        default=1.0, gt=0, le=100, description="lowest angular frequency of the positional encoding"
    )
    encoding_order: Literal["octave", "axis"] = Field(
        default="octave",
        description="octave: sin and cos of xyz, octave by octave; axis: all sines, then all cosines, by axis",
    )
    input_scale: float = Field(
        default=1.0,
        gt=0,
        le=1e6,
        description="points are multiplied by it first, and phi is divided by it, as in NeuS",
    )
    input_offset: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="subtracted from the points before the scale"
    )

    def completed(self) -> NetworkDescription:
        """With the values of the preset where nothing else was given."""
        if self.preset is None:
            return self
        given = {name: getattr(self, name) for name in self.model_fields_set}
        return NetworkDescription(**{**PRESETS[self.preset], **given})


PRESETS: Mapping[Preset, Mapping[str, Any]] = {
    "neus": {"activation": "softplus", "beta": 100.0, "skip_scale": 0.5**0.5},
    "sdfstudio": {
        "activation": "softplus",
        "beta": 100.0,
        "skip_scale": 0.5**0.5,
        "encoding_order": "axis",
    },
    "nerfstudio": {
        "activation": "softplus",
        "beta": 100.0,
        "skip_scale": 0.5**0.5,
        "base_frequency": 6.283185307179586,
        "encoding_order": "axis",
    },
    "deepsdf": {"activation": "relu", "output": "tanh"},
    "siren": {"activation": "sine", "omega": 30.0},
}
"""NeuS (Wang et al. 2021), also IDR and VolSDF: models/fields.py. SDFStudio and nerfstudio: their SDFField without
grid features; its layers have the same names in both, but SDFStudio's encoding leaves out the factor of 2 pi."""

FIELD_PRESETS: frozenset[Preset | None] = frozenset({"sdfstudio", "nerfstudio"})
"""Those whose input goes on with the features of a grid."""
