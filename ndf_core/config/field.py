"""`FieldConfig`: everything that decides how a field over an asset is learned, apart from its values."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class FieldConfig(BaseModel):
    """Options of `ndf field fit` and `ndf_core.fit_field` (Sec. 3.5). Trained as the displacement is."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["continuous", "binary", "categorical"] = Field(
        default="continuous", description="numbers (squared error), truth values or classes (cross entropy)"
    )
    loss: Literal["squared", "absolute"] = Field(
        default="squared",
        description="of continuous fields: the mean is learned, or the median, which ignores outliers",
    )
    feature_dim: int = Field(default=8, ge=0, le=256, description="dimension d of the per-vertex features")
    hidden: int = Field(default=32, ge=4, le=1024, description="units of each hidden layer")
    hidden_layers: int = Field(default=2, ge=1, le=8, description="hidden layers")
    latent: int = Field(
        default=0,
        ge=0,
        le=64,
        description="numbers in the latent code of each field; 0: all fields are outputs of one run of the network",
    )
    steps: int = Field(default=2000, ge=1, le=10_000_000, description="training steps")
    batch: int = Field(default=4096, ge=1, le=2**20, description="surface points per step, each with all fields")
    samples: int = Field(
        default=2**18,
        ge=1,
        le=2**25,
        description="surface points to take batches from, where a mesh has the values",
    )
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of everything random")
    rounding: float = Field(
        default=0.02, gt=0, le=10, description="growth of the error that rounding the numbers in the file may cost"
    )
    size: int = Field(
        default=0,
        ge=0,
        le=2**26,
        description="most bytes that the numbers in the file may take; where `rounding` takes more, features are "
        "rounded to what lowers the error most for its bits, which takes longer; for continuous fields without "
        "latent codes; 0: as many as `rounding` takes",
    )
    encoding_levels: int = Field(default=8, ge=0, le=16, description="octaves of the periodic encoding")
    base_frequency: float = Field(default=math.pi / 3, gt=0, le=1e3, description="lowest angular frequency")
    feature_scale: float = Field(default=0.1, ge=0, le=10, description="standard deviation of the initial features")
    frequency_damping: float = Field(
        default=0.5, gt=0, le=1, description="factor per octave on the initial weights from the encoding"
    )
    optimizer: Literal["muon", "adam"] = Field(default="muon", description="as in `ndf fit`")
    learning_rate: float = Field(default=4e-3, gt=0, le=10, description="peak learning rate of the network")
    feature_learning_rate: float = Field(default=1e-1, gt=0, le=10, description="peak learning rate of the features")
    adam_beta2: float = Field(default=0.99, ge=0, lt=1, description="decay of Adam's squared gradients")
    schedule: Literal["cosine", "constant"] = Field(default="cosine", description="learning rate over the run")
    warmup_steps: int = Field(default=20, ge=0, le=100_000, description="steps in which the rate rises from zero")
    averaged: float = Field(
        default=0.0,
        ge=0,
        lt=1,
        description="share of the steps, at the end, whose parameters' mean is kept; 0 keeps the last ones. With a "
        "constant rate the last ones hold its noise",
    )
