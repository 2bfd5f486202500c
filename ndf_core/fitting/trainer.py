"""The training loop: samples, projection, gradient, update; resumable at any checkpoint (Sec. 3.2, App. A.1)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ndf_core.config.fit import FitConfig
from ndf_core.errors import FitError
from ndf_core.fitting.geometry import BaseGeometry, mapped_frame
from ndf_core.fitting.losses import Anchors, optional_gradient
from ndf_core.fitting.network import Parameters
from ndf_core.fitting.observer import Observer
from ndf_core.fitting.optimizer import Optimizer, rate_factor
from ndf_core.fitting.projection import BoxProjection, BoxProjector
from ndf_core.fitting.sampling import BasePoints, by_rejection, generator_at, mapped_areas, stratified
from ndf_core.fitting.step import FusedStep

_DENSITY_STEPS = 50
"""Steps between updates of the sampling density; the mapped areas settle within the first few."""
_REPORT_SECONDS = 0.5


@dataclass
class Progress:
    """Sums since the last report, and totals over the run."""

    residual: float = 0.0
    cycle: float = 0.0
    steps: int = 0
    converged: int = 0
    projected: int = 0


class Trainer:
    """Trains `parameters` in place. Everything that decides the next step is in `state`, or a function of it."""

    def __init__(
        self,
        parameters: Parameters,
        geometry: BaseGeometry,
        projector: BoxProjector,
        config: FitConfig,
        observer: Observer,
        anchors: Anchors | None = None,
    ) -> None:
        self.parameters = parameters
        self.geometry = geometry
        self.step_count = 0
        self.projected = 0
        self.converged = 0
        self._projector = projector
        self._config = config
        self._observer = observer
        self._anchors = anchors
        self._optimizer = Optimizer(parameters, config)
        self._density = geometry.areas
        self._fused = FusedStep(parameters.shape, config.batch, config.cycle_stride, geometry.device)
        self._kept: BasePoints | None = None

    @property
    def state(self) -> dict[str, Tensor]:
        """Tensors of a checkpoint."""
        return {
            "parameters": self.parameters.flat,
            "density": self._density,
            "counts": torch.tensor([self.step_count, self.projected, self.converged]),
            **self._optimizer.state,
        }

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Go on from a checkpoint of the same run."""
        self.parameters.flat.copy_(state["parameters"])
        self._density = state["density"].to(self.geometry.device)
        self.step_count, self.projected, self.converged = (int(n) for n in state["counts"])
        self._optimizer.load_state(state)

    def run(self, until: int, save: Callable[[], None], after_step: Callable[[], None] | None = None) -> None:
        """Train up to step `until`; calls `save` every `checkpoint_seconds`, and when interrupted.

        Raises:
            FitError: a loss is not finite, or no sample could be projected.
            KeyboardInterrupt: passed on, after `save`.
        """
        report, saved, sums = time.monotonic(), time.monotonic(), Progress()
        try:
            while self.step_count < until:
                self._step(sums)
                now = time.monotonic()
                if now - report > _REPORT_SECONDS:
                    self._report(sums, until, now - report)
                    report, sums = now, Progress()
                if now - saved > self._config.checkpoint_seconds and self._at_boundary():
                    self._check_finite(sums)
                    save()
                    saved = now
                if after_step is not None:
                    after_step()
        except KeyboardInterrupt:
            while not self._at_boundary():
                self._step(sums)
            save()
            raise
        self._report(sums, until, max(time.monotonic() - report, 1e-9))

    def _at_boundary(self) -> bool:
        """Samples that are kept for some steps are not in the checkpoint: save only where new ones are drawn."""
        return self.step_count % self._config.resample_every == 0

    def _step(self, sums: Progress) -> None:
        base = self._samples()
        mapped = self._fused.map(self.parameters, base.batch)
        projection = self._project(base, mapped)
        residual = mapped - projection.points
        count = self._config.batch
        loss = residual.square().sum() / count
        output_gradient = residual.mul_(2.0 * self._config.loss.projection / count)
        cycle = self._fused.backward(self.parameters, base.batch, output_gradient, self._config.loss.cycle)
        extra = optional_gradient(
            self.parameters, self.geometry, base, projection.normals, self._config.loss, self._anchors
        )
        if extra is not None:
            self._fused.gradient.flat.add_(extra)
        self._optimizer.step(self._fused.gradient, rate_factor(self._config, self.step_count))
        self.step_count += 1
        sums.residual += float(loss)
        sums.cycle += float(cycle)
        sums.steps += 1
        if sums.steps % 64 == 0:
            self._check_finite(sums)

    def _samples(self) -> BasePoints:
        config, step = self._config, self.step_count
        if self._kept is not None and step % config.resample_every:
            return self._kept
        generator = generator_at(config.seed, step)
        if config.sampling == "rejection":
            self._kept = by_rejection(self.geometry, self.parameters, config.batch, generator)
        else:
            if step % _DENSITY_STEPS == 0 and step:
                self._density = mapped_areas(self.geometry, self.parameters)
            self._kept = stratified(self.geometry, self._density, config.batch, generator)
        return self._kept

    def _project(self, base: BasePoints, mapped: Tensor) -> BoxProjection:
        directions = None
        if self._projector.needs_directions:
            frame = mapped_frame(self.parameters, self.geometry, base.face, base.barycentric).frame
            directions = frame.normal.detach()
        projection = self._projector.project(mapped, directions)
        self.projected += len(mapped)
        self.converged += int(projection.converged.sum())
        return projection

    def _check_finite(self, sums: Progress) -> None:
        if not (sums.residual < float("inf") and sums.cycle < float("inf")):
            raise FitError(
                f"the loss is not finite at step {self.step_count} (projection {sums.residual:g}, cycle "
                f"{sums.cycle:g}); lower --learning-rate, or look at the input with --recipe paper"
            )
        if self.projected and not self.converged:
            raise FitError(
                f"no sample could be projected to the surface in {self.step_count} steps; is the base mesh near it?"
            )

    def _report(self, sums: Progress, until: int, seconds: float) -> None:
        if not sums.steps:
            return
        self._check_finite(sums)
        rate = sums.steps / seconds
        self._observer.progress(
            self.step_count,
            until,
            (sums.residual / sums.steps) ** 0.5,
            sums.cycle / sums.steps,
            rate * self._config.batch,
            (until - self.step_count) / rate,
        )
