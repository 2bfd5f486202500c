"""The training loop: which rows count, when it gives up, when it saves, and that threads only share out rows."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import torch
from small_surfaces import (
    CENTER,
    RADIUS,
    Altered,
    SphereProjector,
    nothing_converges,
    overflows,
    small_geometry,
    sphere_mesh,
    tiny_config,
    upper_half_fails,
    upper_half_is_nan,
    upper_half_stays,
    without_normals,
)
from torch import Tensor

from ndf_core.errors import FitError
from ndf_core.fitting.identity import initial_parameters
from ndf_core.fitting.interrupts import held_interrupts
from ndf_core.fitting.network import Parameters
from ndf_core.fitting.observer import Observer, Silent, TrainingProgress
from ndf_core.fitting.optimizer import Optimizer
from ndf_core.fitting.projection import BoxProjection, BoxProjector
from ndf_core.fitting.samples import Samples
from ndf_core.fitting.sampling import generator_at, stratified
from ndf_core.fitting.trainer import Trainer
from ndf_core.interfaces import Projection, Projector


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """As `run_fit` does it: threads are ours."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def trainer(
    projector: Projector | None = None, *, threads: int = 1, observer: Observer | None = None, **options: Any
) -> Trainer:
    """On the sphere of the tests; its base mesh in the box frame."""
    points, faces = sphere_mesh()
    scale = RADIUS / 1.5
    geometry = small_geometry(((points - np.array(CENTER)) / scale, faces))
    config = tiny_config(**options)
    box = BoxProjector(projector or SphereProjector(), np.array(CENTER), scale)
    parameters = initial_parameters(geometry, config)
    return Trainer(parameters, geometry, box, config, observer or Silent(), threads=threads)


def flat_after(run: Trainer, steps: int) -> Tensor:
    run.run(steps, lambda: None)
    assert run.step_count == steps
    return run.parameters.flat.clone()


class Recorder(Silent):
    def __init__(self) -> None:
        self.told: list[TrainingProgress] = []

    def progress(self, progress: TrainingProgress) -> None:
        self.told.append(progress)


class TestRowsThatDoNotConverge:
    @pytest.mark.parametrize("fault", [upper_half_fails, upper_half_is_nan])
    def test_left_out_as_if_they_had_no_residual(self, fault: Callable[..., Projection]) -> None:
        """Nonsense, NaN or a projection where the point is already: the same parameters, to the last bit."""
        found, expected = (
            flat_after(trainer(Altered(SphereProjector(), change), steps=20, importance=0.0), 20)
            for change in (fault, upper_half_stays)
        )
        assert bool(torch.isfinite(found).all())
        assert torch.equal(found, expected)
        assert not torch.equal(found, flat_after(trainer(steps=20), 20)), "the rows matter where they converge"

    def test_counted(self) -> None:
        run = trainer(Altered(SphereProjector(), upper_half_fails), steps=20)
        run.run(20, lambda: None)
        assert run.projected == 20 * run.config.batch
        assert run.converged / run.projected == pytest.approx(0.5, abs=0.05)

    @pytest.mark.parametrize("fault", [upper_half_fails, upper_half_is_nan])
    def test_left_out_of_the_optional_losses_too(self, fault: Callable[..., Projection]) -> None:
        loss = {"projection": 1e4, "cycle": 1e2, "normal": 10.0, "conformality": 10.0}
        flats = [
            flat_after(trainer(Altered(SphereProjector(), change), steps=10, loss=loss), 10)
            for change in (fault, upper_half_fails)
        ]
        assert bool(torch.isfinite(flats[0]).all())
        assert torch.equal(*flats)


class TestGivingUp:
    def test_nothing_converges(self) -> None:
        run = trainer(Altered(SphereProjector(), nothing_converges), steps=100)
        with pytest.raises(FitError, match=r"no sample could be projected to the surface in \d+ steps; is the base"):
            run.run(100, lambda: None)
        assert run.step_count <= 64

    def test_a_loss_that_is_not_finite(self) -> None:
        run = trainer(Altered(SphereProjector(), overflows), steps=100)
        message = r"the loss is not finite at step \d+ \(projection (inf|nan).*--learning-rate"
        with pytest.raises(FitError, match=message):
            run.run(100, lambda: None)
        assert run.step_count <= 64

    @pytest.mark.parametrize("sampling", ["stratified", "rejection"])
    def test_parameters_that_are_not_finite_end_the_run(self, sampling: str) -> None:
        run = trainer(steps=100, sampling=sampling)
        run.run(3, lambda: None)
        run.parameters.flat[7] = math.nan
        with pytest.raises(FitError, match=r"not finite"):
            run.run(100, lambda: None)

    def test_the_last_good_checkpoint_is_kept(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A step that overshoots into NaN is not saved, although the loss before it was finite."""
        saved: list[Tensor] = []
        run = trainer(steps=100, checkpoint_seconds=1e-9)
        update = Optimizer.step

        def overshoot(self: Optimizer, gradient: Parameters, factor: float) -> None:
            update(self, gradient, factor)
            if run.step_count == 5:
                run.parameters.flat[7] = math.nan

        monkeypatch.setattr(Optimizer, "step", overshoot)
        with pytest.raises(FitError):
            run.run(100, lambda: saved.append(run.parameters.flat.clone()))
        assert len(saved) == 5
        assert all(bool(torch.isfinite(flat).all()) for flat in saved)


class TestThreads:
    def test_sharing_out_rows_changes_only_rounding(self) -> None:
        one = flat_after(trainer(threads=1, cycle_stride=1, optimizer="adam", steps=3), 3)
        for threads in (2, 3):
            other = flat_after(trainer(threads=threads, cycle_stride=1, optimizer="adam", steps=3), 3)
            torch.testing.assert_close(other, one, rtol=1e-3, atol=1e-4)

    @pytest.mark.parametrize("threads", [1, 2, 3])
    def test_the_same_bits_every_time(self, threads: int) -> None:
        first, second = (flat_after(trainer(threads=threads, steps=10), 10) for _ in range(2))
        assert torch.equal(first, second)

    def test_more_threads_than_rows(self) -> None:
        assert bool(torch.isfinite(flat_after(trainer(threads=5, batch=2, steps=3), 3)).all())


class TestDirections:
    def test_unit_normals_of_the_mapped_surface_where_they_are_needed(self) -> None:
        inner = Altered(SphereProjector(), lambda query, answer: answer, needs_directions=True)
        flat_after(trainer(inner, steps=3), 3)
        for directions in inner.directions:
            assert directions is not None
            torch.testing.assert_close(directions.norm(dim=1), torch.ones(len(directions), dtype=torch.float64))

    def test_none_elsewhere(self) -> None:
        inner = Altered(SphereProjector(), lambda query, answer: answer)
        flat_after(trainer(inner, steps=3), 3)
        assert inner.directions == [None] * 3


class TestResuming:
    @pytest.mark.parametrize(
        "options",
        [
            {},
            {"resample_every": 10, "sampling": "rejection", "optimizer": "adam"},
            {"projection_visits": 3},
            {"resample_every": 2, "projection_visits": 2},
            {"resample_every": 7},
        ],
        ids=str,
    )
    def test_from_any_place_where_it_saves(self, options: dict[str, Any]) -> None:
        """State put into a new trainer leads to the same end; the density is renewed on the way (step 50)."""
        options = {"steps": 65, "checkpoint_seconds": 1e-9, "batch": 60, **options}
        whole = trainer(**options)
        states: list[dict[str, Tensor]] = []
        whole.run(65, lambda: states.append({name: tensor.clone() for name, tensor in whole.state.items()}))
        assert int(states[-1]["counts"][0]) == 65
        for state in (states[0], states[len(states) // 2], states[-2], states[-1]):
            resumed = trainer(**options)
            resumed.load_state(state)
            resumed.run(65, lambda: None)
            assert torch.equal(resumed.parameters.flat, whole.parameters.flat)
            assert (resumed.projected, resumed.converged) == (whole.projected, whole.converged)


class TestInterrupts:
    def press_at(self, run: Trainer, *calls: int) -> None:
        """SIGINT while the plugin is projecting, in the middle of a step."""
        inner, count = run.projector.project, 0

        def project(*arguments: Any) -> BoxProjection:
            nonlocal count
            count += 1
            if count in calls:
                signal.raise_signal(signal.SIGINT)
            return inner(*arguments)

        run.projector.project = project

    @pytest.mark.parametrize(
        ("period", "pressed", "saved"), [(1, 4, [4]), (10, 4, [10]), (10, 10, [10]), (10, 23, [25]), (10, 1, [10])]
    )
    def test_the_step_is_finished_and_the_state_saved_once(self, period: int, pressed: int, saved: list[int]) -> None:
        """Samples kept for ten steps are not in the checkpoint: those ten are finished, but none past the end."""
        run = trainer(steps=25, resample_every=period)
        self.press_at(run, pressed)
        steps: list[int] = []
        with pytest.raises(KeyboardInterrupt):
            run.run(25, lambda: steps.append(run.step_count))
        assert steps == saved
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def test_the_second_time_at_once(self) -> None:
        run = trainer(steps=25, resample_every=10)
        self.press_at(run, 4, 6)
        steps: list[int] = []
        with pytest.raises(KeyboardInterrupt):
            run.run(25, lambda: steps.append(run.step_count))
        assert steps == [] and run.step_count == 5
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def test_nothing_is_held_where_it_is_not_ours(self) -> None:
        """Neither in other threads nor over a handler of the program."""
        seen: list[object] = []

        def look() -> None:
            with held_interrupts():
                seen.append(signal.getsignal(signal.SIGINT))

        thread = threading.Thread(target=look)
        thread.start()
        thread.join()
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            look()
        finally:
            signal.signal(signal.SIGINT, before)
        assert seen == [signal.default_int_handler, signal.SIG_IGN]


def test_progress_is_that_of_the_steps() -> None:
    recorder = Recorder()
    run = trainer(steps=20, observer=recorder)
    run.run(20, lambda: None)
    step, total, rms, cycle, rate, left = recorder.told[-1]
    assert (step, total, left) == (20, 20, 0)
    # The icosphere of 80 faces lies up to 0.1 inside its sphere at the start.
    assert 1e-3 < rms < 0.1 and 0 < cycle < 1 and rate > 0


class TestPlanes:
    """Visiting batches against the planes of earlier projections."""

    def setting(self, inner: Projector) -> tuple[Samples, Tensor, BoxProjector]:
        """The unit sphere, points a tenth above it, and the planes below them."""
        geometry = small_geometry()
        base = stratified(geometry, geometry.areas, 90, generator_at(0, 0))
        mapped = base.batch.positions * 1.1
        projector = BoxProjector(inner, np.array([0.0, 0.0, CENTER[2]]), 1.0)
        return Samples(base, torch.zeros(0, 3), projector.project(mapped)), mapped, projector

    def test_they_answer_to_second_order(self) -> None:
        """Moved by h along the sphere, the foot on the plane leaves the sphere by less than h^2."""
        samples, mapped, projector = self.setting(SphereProjector((0.0, 0.0, CENTER[2]), 1.0))
        same, asked = samples.project(slice(0, 90), mapped, lambda: pytest.fail("asked"))
        assert not asked and bool(same.converged.all())
        torch.testing.assert_close(same.points, projector.project(mapped).points)
        for h in (0.1, 0.01):
            along = torch.nn.functional.normalize(torch.linalg.cross(mapped, torch.ones(90, 3)), dim=1)
            moved = mapped + h * along
            foot = samples.project(slice(0, 90), moved, lambda: pytest.fail("asked"))[0].points
            assert float((foot.norm(dim=1) - 1).abs().max()) < h * h
            assert float((foot - projector.project(moved).points).norm(dim=1).max()) < 0.2 * h
        part, _ = samples.project(slice(20, 50), moved[20:50], lambda: pytest.fail("asked"))
        assert torch.equal(part.points, foot[20:50])

    def test_rows_that_failed_stay_out(self) -> None:
        inner = Altered(SphereProjector((0.0, 0.0, CENTER[2]), 1.0), upper_half_fails)
        samples, mapped, _ = self.setting(inner)
        again, _ = samples.project(slice(0, 90), mapped + 0.1, lambda: pytest.fail("asked"))
        bad = mapped[:, 2] > 0
        assert torch.equal(again.converged, ~bad)
        assert torch.equal(again.points[bad], (mapped + 0.1)[bad])

    def test_without_normals_the_projector_is_asked(self) -> None:
        inner = Altered(SphereProjector((0.0, 0.0, CENTER[2]), 1.0), without_normals)
        samples, mapped, projector = self.setting(inner)
        assert samples.project(slice(0, 90), mapped, lambda: projector.project(mapped))[1]
        run = trainer(Altered(SphereProjector(), without_normals), projection_visits=3, steps=9, batch=30)
        run.run(9, lambda: None)
        assert run.projected == 9 * 30

    @pytest.mark.parametrize("visits", [2, 3])
    def test_the_projector_is_asked_once_for_all_visits(self, visits: int) -> None:
        inner = Altered(SphereProjector(), lambda query, answer: answer, needs_directions=True)
        run = trainer(inner, projection_visits=visits, steps=5 * visits**2, batch=30)
        run.run(5 * visits**2, lambda: None)
        assert [None if rows is None else len(rows) for rows in inner.directions] == [30 * visits] * 5
        assert run.projected == run.converged == 5 * visits * 30

    def test_they_train(self) -> None:
        """Almost as well per step as fresh projections."""
        ends: list[float] = []
        for visits in (1, 4):
            recorder = Recorder()
            run = trainer(projection_visits=visits, steps=400, hidden_width=32, observer=recorder)
            run.run(390, lambda: None)
            run.run(400, lambda: None)
            ends.append(recorder.told[-1][2])
        assert ends[1] < 2 * ends[0]
