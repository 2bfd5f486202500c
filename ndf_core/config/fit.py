"""`FitConfig`: everything that decides what a fit does, apart from the surface."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class LossWeights(BaseModel):
    """Weights of the loss terms (Sec. 3.2 eq. total-loss, App. D; Table 3)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    projection: float = Field(
        default=1e4, ge=0, description="lambda_P: squared distance from the mapped point to its projection"
    )
    cycle: float = Field(
        default=1e2, ge=0, description="lambda_C: squared error of the inverse network after the map"
    )
    anchor: float = Field(
        default=0.0, ge=0, description="lambda_A: squared distance of the anchors from their targets (App. D.1)"
    )
    normal: float = Field(
        default=0.0, ge=0, description="squared difference of the mapped normal and the surface's (App. D.2)"
    )
    conformality: float = Field(default=0.0, ge=0, description="softplus of -det J / tr J^T J (App. D.3)")


class FitConfig(BaseModel):
    """Options of `ndf fit` and `ndf_core.fit`. Lengths are in the box frame (longest side of the base mesh = 3)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    recipe: Literal["fast", "paper"] = Field(
        default="fast", description="training recipe; `paper` is App. A.1 to the letter"
    )
    faces: int = Field(default=2000, ge=4, le=2_000_000, description="most faces of the base mesh")
    feature_dim: int = Field(
        default=16, ge=0, le=256, description="dimension d of the per-vertex features (Sec. 3.3)"
    )
    steps: int = Field(default=1500, ge=0, le=10_000_000, description="training steps after the initialisation")
    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of everything random")
    device: Literal["auto", "cpu", "cuda"] = Field(default="auto", description="where the networks are trained")
    threads: int = Field(
        default=0, ge=0, le=1024, description="CPU threads; 0 takes all. Part of what makes a run repeatable"
    )
    batch: int = Field(default=8192, ge=1, le=2**24, description="samples per step (the paper's s)")
    loss: LossWeights = LossWeights()
