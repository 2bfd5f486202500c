"""The training loop: samples, projection, gradient, update; resumable at any checkpoint (Sec. 3.2, App. A.1)."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import torch
from torch import Tensor

from ndf_core.config.fit import FitConfig
from ndf_core.errors import FitError
from ndf_core.fitting.coverage import Coverage
from ndf_core.fitting.geometry import BaseGeometry, mapped_frame
from ndf_core.fitting.importance import FaceErrors
from ndf_core.fitting.interrupts import held_interrupts
from ndf_core.fitting.losses import Anchors, optional_gradient
from ndf_core.fitting.network import Parameters, displace, interpolate
from ndf_core.fitting.observer import Observer, TrainingProgress
from ndf_core.fitting.optimizer import Optimizer, rate_factor
from ndf_core.fitting.projection import BoxProjection, BoxProjector
from ndf_core.fitting.samples import Samples
from ndf_core.fitting.sampling import BasePoints, by_rejection, generator_at, joined, mapped_areas, stratified
from ndf_core.fitting.step import FusedStep, tile_size

_AREA_STEPS = 50
"""Steps between updates of the mapped areas; they settle within the first few."""
_REPORT_SECONDS = 0.5
_ROWS_PER_SQUARED_WORKER = 768
"""Arithmetic of so many rows takes as long as the Python between the operations of one step."""


@dataclass
class Progress:
    """Sums since the last report, and totals over the run."""

    residual: float = 0.0
    cycle: float = 0.0
    steps: int = 0
    converged: int = 0
    projected: int = 0

    def add(self, other: Progress) -> None:
        """Add a worker's losses."""
        self.residual += other.residual
        self.cycle += other.cycle


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
        threads: int = 1,
    ) -> None:
        self.parameters = parameters
        self.geometry = geometry
        self.step_count = 0
        self.projected = 0
        self.converged = 0
        self.pulled = 0
        """Samples drawn so far that were pulled over an uncovered spot (`coverage`)."""
        self.projector = projector
        self.config = config
        self._observer = observer
        self.anchors = anchors
        self._optimizer = Optimizer(parameters, config)
        self._coverage = Coverage(geometry, projector, config, threads)
        self._areas = geometry.areas
        self._areas_due = _AREA_STEPS
        self._errors = FaceErrors(len(geometry.faces), geometry.device)
        self.squared = torch.zeros(config.batch, device=geometry.device)
        """Squared distances from the surface of this step's samples; workers fill in their rows."""
        self.known = torch.zeros(config.batch, dtype=torch.bool, device=geometry.device)
        # One worker per thread, each with whole torch operations on its own rows: unlike threads inside an operation
        # these do not wait for each other forty times a step, which is what hurts on a busy machine.
        workers = threads if torch.device(geometry.device).type == "cpu" else 1
        self._slices = row_slices(config.batch, workers, tile_size(config.batch, geometry.device))
        self._workers = [_Worker(self, slices) for slices in self._slices]
        self._pool = ThreadPoolExecutor(len(self._workers) - 1) if len(self._workers) > 1 else None
        self._kept: list[Samples] = []

    @property
    def state(self) -> dict[str, Tensor]:
        """Tensors of a checkpoint."""
        return {
            "parameters": self.parameters.flat,
            "areas": self._areas,
            "counts": torch.tensor([self.step_count, self.projected, self.converged, self.pulled, self._areas_due]),
            **self._errors.state,
            **self._coverage.state,
            **self._optimizer.state,
        }

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Go on from a checkpoint of the same run."""
        self.parameters.flat.copy_(state["parameters"])
        self._areas = state["areas"].to(self.geometry.device)
        counts = (int(n) for n in state["counts"])
        self.step_count, self.projected, self.converged, self.pulled, self._areas_due = counts
        self._errors.load_state(state)
        self._coverage.load_state(state)
        self._optimizer.load_state(state)

    def run(self, until: int, save: Callable[[], None]) -> None:
        """Train up to step `until`; calls `save` every `checkpoint_seconds`, and when interrupted.

        Raises:
            FitError: a loss is not finite, or no sample could be projected; the last checkpoint is kept.
            KeyboardInterrupt: on SIGINT, after the steps that share samples are done and `save` was called.
        """
        report, saved, sums = time.monotonic(), time.monotonic(), Progress()
        with held_interrupts() as interrupts:
            while self.step_count < until and not (interrupts.came and self._can_save()):
                self._step(sums)
                now = time.monotonic()
                if now - report > _REPORT_SECONDS:
                    self._report(sums, until, now - report)
                    report, sums = now, Progress()
                if now - saved > self.config.checkpoint_seconds and self._can_save():
                    self._check_finite(sums)
                    save()
                    saved = now
            if interrupts.came:
                self._check_finite(sums)
                if self._can_save():
                    save()
                raise KeyboardInterrupt
        self._report(sums, until, max(time.monotonic() - report, 1e-9))

    def _can_save(self) -> bool:
        """Samples that are kept for some steps are not in the checkpoint: save only where new ones are drawn."""
        period = self.config.resample_every * self.config.projection_visits**2
        return self.step_count % period == 0 or self.step_count >= self.config.steps

    def _step(self, sums: Progress) -> None:
        samples = self._samples()
        others = self._workers[1:]
        waiting = [self._pool.submit(worker.gradient_of, samples) for worker in others] if self._pool else []
        for part in [self._workers[0].gradient_of(samples), *(future.result() for future in waiting)]:
            sums.add(part)
            self.projected += part.projected
            self.converged += part.converged
        drawn = len(samples.base.face) - samples.pulls
        self._errors.add(samples.base.face[:drawn], self.squared[:drawn], self.known[:drawn])
        gradient = self._workers[0].gradient
        for worker in self._workers[1:]:
            gradient.flat.add_(worker.gradient.flat)
        self._optimizer.step(gradient, rate_factor(self.config, self.step_count))
        self.step_count += 1
        sums.steps += 1
        if sums.steps % 64 == 0:
            self._check_finite(sums)

    def _samples(self) -> Samples:
        """The batch of this step.

        With v = `projection_visits` > 1, v batches are drawn and projected together and then visited in turn, v
        times each, against their planes: every v^2 steps everything is new.
        """
        config, visits = self.config, self.config.projection_visits
        if self.step_count % (config.resample_every * visits**2) == 0 or not self._kept:
            if visits == 1:
                self._kept = [Samples(*self._draw(self.step_count))]
            else:
                self._kept = self._with_planes([self._draw(self.step_count + i) for i in range(visits)])
        return self._kept[self.step_count // config.resample_every % visits]

    def _with_planes(self, drawn: list[tuple[BasePoints, Tensor]]) -> list[Samples]:
        base = joined(*(points for points, _ in drawn))
        features = interpolate(self.parameters.features, base.batch.corners, base.barycentric)
        found = self.project(base, displace(self.parameters, base.batch.positions, features))
        if found.normals is None:
            return [Samples(*batch) for batch in drawn]
        self.projected += len(found.converged)
        self.converged += int(found.converged.sum())
        size = self.config.batch
        planes = zip(found.points.split(size), found.converged.split(size), found.normals.split(size), strict=True)
        return [Samples(*batch, BoxProjection(*part)) for batch, part in zip(drawn, planes, strict=True)]

    def project(self, base: BasePoints, mapped: Tensor) -> BoxProjection:
        """Projections of mapped points, along the mapped normals where the projector wants them."""
        directions = None
        if self.projector.needs_directions:
            directions = mapped_frame(
                self.parameters, self.geometry, base.face, base.barycentric
            ).frame.normal.detach()
        return self.projector.project(mapped, directions)

    def _draw(self, stream: int) -> tuple[BasePoints, Tensor]:
        """Base points of a batch, and the targets of the last of them, which are pulls."""
        config = self.config
        generator = generator_at(config.seed, stream)
        self._coverage.look(self.parameters, self.step_count)
        count = config.batch - self._coverage.rows
        if config.sampling == "rejection":
            base = by_rejection(self.geometry, self.parameters, count, generator)
        else:
            if self.step_count >= self._areas_due:
                self._areas = mapped_areas(self.geometry, self.parameters)
                self._areas_due = self.step_count + _AREA_STEPS
            density = self._errors.density(self._areas, config.importance) if config.importance else None
            base = stratified(self.geometry, self._areas, count, generator, density)
        pulls = self._coverage.draw(generator)
        self.pulled += config.batch - count
        return joined(base, pulls.base), pulls.targets

    def _check_finite(self, sums: Progress) -> None:
        finite = sums.residual < float("inf") and sums.cycle < float("inf")
        if not (finite and bool(torch.isfinite(self.parameters.flat).all())):
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
            TrainingProgress(
                step=self.step_count,
                total=until,
                projection_rms=(sums.residual / sums.steps) ** 0.5,
                cycle_loss=sums.cycle / sums.steps,
                samples_per_second=rate * self.config.batch,
                seconds_left=(until - self.step_count) / rate,
            )
        )


def worthwhile_workers(batch: int) -> int:
    """Most threads that make a step of `batch` rows faster.

    Python runs one thread at a time between torch's operations, so each worker adds its own share of that to every
    step while the arithmetic shrinks by their number: the best number grows with the root of the rows. Of 3,072 rows
    on 16 cores a step takes 7.8 ms with one worker, 6.7 with two, 11 with four, 36 with twelve; of 12,288 rows 24 ms
    with one, 13 with four, 27 with eight.
    """
    return max(1, round((batch / _ROWS_PER_SQUARED_WORKER) ** 0.5))


def row_slices(batch: int, workers: int, tile: int) -> list[list[slice]]:
    """Rows of the batch for each worker, in tiles of at most `tile` rows that differ by at most one in size."""
    workers = min(workers, batch)
    count = workers * -(-batch // (workers * tile))
    edges = [batch * i // count for i in range(count + 1)]
    tiles = [slice(start, end) for start, end in itertools.pairwise(edges)]
    return [tiles[worker::workers] for worker in range(workers)]


class _Worker:
    """Gradient of the losses on some rows of each batch."""

    def __init__(self, trainer: Trainer, slices: list[slice]) -> None:
        self._trainer = trainer
        self._slices = slices
        parameters, device = trainer.parameters, trainer.geometry.device
        sizes = {part.stop - part.start for part in slices}
        self.gradient = Parameters.zeros(parameters.shape, device)
        self._fused = {
            n: FusedStep(parameters.shape, n, trainer.config.cycle_stride, device, self.gradient) for n in sizes
        }

    def gradient_of(self, samples: Samples) -> Progress:
        """Fill `gradient` with this worker's share of the batch's mean; return its share of the sums."""
        self.gradient.flat.zero_()
        sums = Progress()
        for rows in self._slices:
            self._add(samples, rows, sums)
        return sums

    def _add(self, samples: Samples, rows: slice, sums: Progress) -> None:
        base = samples.base.rows(rows.start, rows.stop)
        trainer, weights = self._trainer, self._trainer.config.loss
        parameters, count = trainer.parameters, len(base.face)
        share = count / trainer.config.batch
        fused = self._fused[count]
        mapped = fused.map(parameters, base.batch)
        projection, fresh = samples.project(rows, mapped, lambda: trainer.project(base, mapped))
        if fresh:
            sums.projected += count
            sums.converged += int(projection.converged.sum())
        residual = mapped - projection.points
        squared = residual.square().sum(1)
        trainer.squared[rows], trainer.known[rows] = squared, projection.converged
        if base.weight is not None:
            squared = squared * base.weight
            residual.mul_(base.weight[:, None])
        sums.residual += float(squared.sum()) / trainer.config.batch
        residual.mul_(2.0 * weights.projection / trainer.config.batch)
        cycle = fused.backward(parameters, base.batch, residual, share * weights.cycle, trainer.step_count)
        sums.cycle += share * float(cycle)
        extra = optional_gradient(parameters, trainer.geometry, base, projection.normals, weights, trainer.anchors)
        if extra is not None:
            self.gradient.flat.add_(extra, alpha=share)
