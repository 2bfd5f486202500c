"""`FitConfig`: everything that decides what a fit does, apart from the surface."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class LossWeights(BaseModel):
    """Weights of the loss terms (Sec. 3.2 eq. total-loss, App. D; Table 3)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    projection: float = Field(
        default=1e4, gt=0, le=1e12, description="lambda_P: squared distance from the mapped point to its projection"
    )
    cycle: float = Field(
        default=1e2, ge=0, le=1e12, description="lambda_C: squared error of the inverse network after the map"
    )
    anchor: float | None = Field(
        default=None,
        ge=0,
        le=1e12,
        description="lambda_A: squared distance of mapped anchors from their targets (App. D.1); none: 0.1 lambda_P "
        "where there are anchors, 0.02 lambda_P with base_from",
    )
    normal: float | None = Field(
        default=None,
        ge=0,
        le=1e12,
        description="squared difference of the mapped and the surface's normal (App. D.2); none: 3e-4 lambda_P with "
        "base_from where the surface has normals, else 0",
    )
    conformality: float | None = Field(
        default=None,
        ge=0,
        le=1e12,
        description="softplus of -det J / tr J^T J (App. D.3); none: 3e-4 lambda_P with base_from, else 0",
    )


class FitConfig(BaseModel):
    """Options of `ndf fit` and `ndf_core.fit`. Lengths are in the box frame (longest side of the base mesh = 3)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    recipe: Literal["fast", "paper"] = Field("fast", description="training recipe; `paper` is App. A.1 to the letter")
    faces: int = Field(default=2000, ge=4, le=2_000_000, description="most faces of the base mesh")
    feature_dim: int = Field(
        default=16, ge=0, le=256, description="dimension d of the per-vertex features (Sec. 3.3)"
    )
    steps: int = Field(default=1600, ge=0, le=10_000_000, description="training steps after the initialisation")
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of everything random")
    device: Literal["auto", "cpu", "cuda"] = Field("auto", description="where the networks are trained")
    threads: int = Field(
        default=0,
        ge=0,
        le=1024,
        description="CPU threads; 0 for all, in training for as many as pay. Part of what makes a run repeatable",
    )
    loss: LossWeights = LossWeights()
    anchors: str | None = Field(
        default=None,
        description="CSV file with rows px,py,pz,qx,qy,qz, input units: a point near the base mesh (with base_from: "
        "near that asset's surface, in its units) and its target",
    )
    base_from: str | None = Field(
        default=None,
        description="asset whose base mesh is fitted to the input, led by anchors, instead of one of its own",
    )

    colors: bool = Field(default=False, description="also learn the input's colours, as the field `color`")

    hidden_width: int = Field(default=64, ge=4, le=1024, description="units of each hidden layer (Sec. 3.3)")
    hidden_layers: int = Field(default=2, ge=1, le=8, description="hidden layers of each network (Sec. 3.3)")
    encoding_levels: int = Field(default=8, ge=0, le=16, description="octaves of the periodic encoding (Sec. 3.3)")
    base_frequency: float = Field(
        default=math.pi / 3,
        gt=0,
        le=1e3,
        description="lowest angular frequency; pi/3 has period 6, so the box of 3 is unique",
    )

    batch: int = Field(default=3072, ge=1, le=2**22, description="samples per step (the paper's s)")
    sampling: Literal["stratified", "rejection"] = Field(
        "stratified", description="how base points are drawn in proportion to |det J|: per face, or point by point"
    )
    importance: float = Field(
        default=0.95,
        ge=0,
        lt=1,
        description="share of stratified samples drawn in proportion to the error of their face; 0 draws all evenly",
    )
    resample_every: int = Field(default=1, ge=1, le=100_000, description="steps that a set of samples is kept")
    projection_visits: int = Field(
        default=1,
        ge=1,
        le=64,
        description="steps that each sample serves for against the plane of one projection; 1 projects at every step",
    )
    coverage_every: int = Field(
        default=100,
        ge=0,
        le=1_000_000,
        description="steps between looks for spots of the surface that the map leaves uncovered; 0 never looks",
    )
    cycle_stride: int = Field(default=4, ge=1, le=1024, description="the cycle loss is taken on every n-th sample")

    identity_steps: int = Field(
        default=0,
        ge=0,
        le=1_000_000,
        description="steps that train both networks to the identity first; 0 starts them there",
    )
    feature_scale: float = Field(default=0.5, ge=0, le=10, description="standard deviation of the initial features")
    frequency_damping: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="factor per octave on the forward network's initial weights from the encoding",
    )
    optimizer: Literal["muon", "adam"] = Field(
        "muon", description="muon orthogonalises the hidden matrices' updates and leaves the rest to Adam"
    )
    learning_rate: float = Field(default=4e-3, gt=0, le=10, description="peak learning rate of the networks")
    feature_learning_rate: float = Field(default=3e-1, gt=0, le=10, description="peak learning rate of the features")
    adam_beta2: float = Field(default=0.99, ge=0, lt=1, description="decay of Adam's squared gradients")
    schedule: Literal["cosine", "constant"] = Field("cosine", description="learning rate over the run")
    warmup_steps: int = Field(
        default=20, ge=0, le=100_000, description="steps over which the learning rate rises from zero"
    )

    keep_inverse: bool = Field(
        default=True, description="store the inverse network too: clients map points near the surface back with it"
    )
    checkpoint_seconds: float = Field(default=20.0, gt=0, le=1e6, description="seconds between checkpoints")
