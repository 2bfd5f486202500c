"""Fits on a CUDA device: as near as on the CPU, and resumed from where they were."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
from small_assets import torus

import ndf_core
from ndf_core.config.fit import FitConfig
from ndf_core.fitting.checkpoint import checkpoint_path
from ndf_core.fitting.observer import Silent, TrainingProgress
from ndf_core.fitting.pipeline import FitResult, run_fit
from ndf_core.interfaces import Surface
from ndf_core.meshio import write_mesh

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="trains on a CUDA device; torch sees none here")

STEPS = 1000
OPTIONS: dict[str, Any] = {
    "faces": 200,
    "steps": STEPS,
    "batch": 1000,
    "seed": 3,
    "hidden_width": 32,
    "encoding_levels": 3,
    "feature_dim": 4,
    "checkpoint_seconds": 0.05,
}


class Stops(Silent):
    """Interrupts the fit when it first tells how far it is."""

    def __init__(self) -> None:
        self.step = 0

    def progress(self, progress: TrainingProgress) -> None:
        self.step = progress.step
        raise KeyboardInterrupt


@pytest.fixture
def surface(tmp_path: Path) -> Surface:
    path = tmp_path / "torus.ply"
    write_mesh(path, *torus())
    return ndf_core.open(path, repr="mesh")


def fitted(surface: Surface, device: str, output: Path | None = None, **keywords: Any) -> FitResult:
    return run_fit(surface, FitConfig.model_validate(OPTIONS | {"device": device}), output=output, **keywords)


def test_as_near_as_on_the_cpu(surface: Surface) -> None:
    there, here = (fitted(surface, device).report for device in ("auto", "cpu"))
    assert there["device"] == "cuda"
    for way in ("field_to_surface", "surface_to_field"):
        assert there["error"][way]["rms"] < 1.1 * here["error"][way]["rms"]


def test_interrupted_and_resumed(surface: Surface, tmp_path: Path) -> None:
    """As near as the fit that was left alone; sums on a CUDA device come in any order, so not to the bit."""
    whole, output = fitted(surface, "cuda").report, tmp_path / "a.ndf"
    stops = Stops()
    with pytest.raises(KeyboardInterrupt):
        fitted(surface, "cuda", output, observer=stops)
    assert 0 < stops.step < STEPS
    assert checkpoint_path(output).exists()
    resumed = fitted(surface, "cuda", output, resume=True).report
    assert resumed["steps"] == STEPS
    assert resumed["error"]["field_to_surface"]["rms"] < 1.1 * whole["error"]["field_to_surface"]["rms"]
