"""`run_fit`: the same bytes for the same seed, however often it was interrupted; what it reports and refuses."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from small_surfaces import (
    CENTER,
    RADIUS,
    Altered,
    SphereProjector,
    overflows,
    sphere_surface,
    tiny_config,
    torus_surface,
    upper_half_fails,
)
from torch import Tensor

from ndf_core.asset.asset import Asset
from ndf_core.config.resolve import Given, resolve_config
from ndf_core.errors import ConfigError, FitError, ResumeError
from ndf_core.fitting import measure as measure_module
from ndf_core.fitting import pipeline, quantise
from ndf_core.fitting.checkpoint import checkpoint_path
from ndf_core.fitting.observer import Silent
from ndf_core.fitting.pipeline import FitResult, run_fit
from ndf_core.interfaces import Projection, Surface


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer samples for quantising and measuring, which are not the subject here."""
    monkeypatch.setattr(quantise, "_SAMPLES", 500)
    monkeypatch.setattr(quantise, "_PROBE_SAMPLES", 300)
    dense = measure_module.dense_map
    monkeypatch.setattr(measure_module, "dense_map", lambda count, mapping: dense(count, mapping, 2000))
    monkeypatch.setattr(pipeline, "measure", partial(measure_module.measure, samples=1000))


class Recorder(Silent):
    def __init__(self) -> None:
        self.stages: list[str] = []
        self.messages: list[str] = []

    def stage(self, name: str) -> None:
        self.stages.append(name)

    def message(self, text: str) -> None:
        self.messages.append(text)


def fit(output: Path | None, surface: Surface | None = None, *, resume: bool = False, **options: Any) -> FitResult:
    return run_fit(surface or sphere_surface(), tiny_config(**options), output=output, resume=resume)


def fit_bytes(output: Path, surface: Surface | None = None, *, resume: bool = False, **options: Any) -> bytes:
    fit(output, surface, resume=resume, **options)
    assert [file.name for file in output.parent.iterdir() if file.suffix != ".csv"] == [output.name]
    data = output.read_bytes()
    output.unlink()
    return data


def pressing(*calls: int, change: Callable[[Tensor, Projection], Projection] | None = None) -> Surface:
    """The sphere; Ctrl-C is pressed while it projects for the n-th time."""
    count = 0

    def look(query: Tensor, answer: Projection) -> Projection:
        nonlocal count
        count += 1
        if count in calls:
            signal.raise_signal(signal.SIGINT)
        return change(query, answer) if change else answer

    return sphere_surface(Altered(SphereProjector(), look))


RUNS: dict[str, dict[str, Any]] = {
    "stratified": {},
    "rejection, samples kept": {"sampling": "rejection", "resample_every": 10, "optimizer": "adam"},
    "two threads": {"threads": 2},
    "three threads, deep": {"threads": 3, "hidden_layers": 3, "feature_dim": 0},
    "samples kept, odd end": {"resample_every": 7},
    "planes": {"projection_visits": 2},
    "trained identity": {"identity_steps": 3, "schedule": "constant"},
    "optional losses": {"loss": {"projection": 1e4, "cycle": 1e2, "normal": 1.0, "conformality": 1.0}},
}


class TestSameBytes:
    @pytest.mark.parametrize("options", RUNS.values(), ids=RUNS)
    def test_same_seed(self, tmp_path: Path, options: dict[str, Any]) -> None:
        """Also when checkpoints are written on the way."""
        first = fit_bytes(tmp_path / "a.ndf", **options)
        assert fit_bytes(tmp_path / "b.ndf", **options) == first
        assert fit_bytes(tmp_path / "c.ndf", checkpoint_seconds=1e-9, **options) == first

    @pytest.mark.parametrize("options", [{}, {"sampling": "rejection"}], ids=str)
    def test_other_seed(self, tmp_path: Path, options: dict[str, Any]) -> None:
        first = fit_bytes(tmp_path / "a.ndf", seed=1, **options)
        assert fit_bytes(tmp_path / "b.ndf", seed=2, **options) != first

    def test_the_program_s_random_numbers_have_no_part_in_it(self, tmp_path: Path) -> None:
        first = fit_bytes(tmp_path / "a.ndf")
        torch.manual_seed(5)
        np.random.seed(5)  # noqa: NPY002
        before = torch.get_rng_state()
        assert fit_bytes(tmp_path / "a.ndf") == first
        assert torch.equal(torch.get_rng_state(), before)


class TestResume:
    @pytest.mark.parametrize("options", RUNS.values(), ids=RUNS)
    @pytest.mark.parametrize("call", [1, 7])
    def test_interrupted_and_resumed(self, tmp_path: Path, options: dict[str, Any], call: int) -> None:
        whole = fit_bytes(tmp_path / "a.ndf", **options)
        output = tmp_path / "b.ndf"
        with pytest.raises(KeyboardInterrupt):
            fit(output, pressing(call), **options)
        assert [file.name for file in tmp_path.iterdir()] == ["b.ndf.checkpoint"]
        assert fit_bytes(output, resume=True, **options) == whole

    def test_again_and_again(self, tmp_path: Path) -> None:
        whole = fit_bytes(tmp_path / "a.ndf")
        output = tmp_path / "b.ndf"
        for _ in range(6):
            with pytest.raises(KeyboardInterrupt):
                fit(output, pressing(4), resume=True)
        assert fit_bytes(output, resume=True) == whole

    def test_rows_that_do_not_converge_are_counted_on(self, tmp_path: Path) -> None:
        """The share of them is in the asset."""
        surface = sphere_surface(Altered(SphereProjector(), upper_half_fails))
        whole = fit_bytes(tmp_path / "a.ndf", surface)
        output = tmp_path / "b.ndf"
        with pytest.raises(KeyboardInterrupt):
            fit(output, pressing(13, change=upper_half_fails))
        assert fit_bytes(output, surface, resume=True) == whole

    @pytest.mark.parametrize("stage", ["quantise", "measure"])
    def test_interrupted_after_training(self, tmp_path: Path, stage: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """Nothing is trained again."""
        whole = fit_bytes(tmp_path / "a.ndf")
        output = tmp_path / "b.ndf"

        def interrupted(*arguments: Any, **options: Any) -> None:
            real(*arguments, **options)  # quantising changes the parameters in place
            raise KeyboardInterrupt

        real = getattr(pipeline, stage)
        with monkeypatch.context() as patch:
            patch.setattr(pipeline, stage, interrupted)
            with pytest.raises(KeyboardInterrupt):
                fit(output)
        recorder = Recorder()
        run_fit(sphere_surface(), tiny_config(), output=output, resume=True, observer=recorder)
        assert recorder.messages == ["resumed at step 30 of 30"]
        assert output.read_bytes() == whole

    def test_remarks_on_the_base_mesh_are_not_forgotten(self, tmp_path: Path) -> None:
        output = tmp_path / "b.ndf"
        expected = fit(None).report["base_mesh"]
        with pytest.raises(KeyboardInterrupt):
            fit(output, pressing(5))
        found = fit(output, resume=True).report["base_mesh"]
        assert found == expected
        assert [remark["kind"] for remark in found["remarks"]] == ["dropped_component"]

    def test_nothing_to_resume(self, tmp_path: Path) -> None:
        recorder = Recorder()
        run_fit(sphere_surface(), tiny_config(), output=tmp_path / "a.ndf", resume=True, observer=recorder)
        assert "no checkpoint a.ndf.checkpoint: starting from the beginning" in recorder.messages
        with pytest.raises(ResumeError, match="needs the output path"):
            fit(None, resume=True)

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"steps": 31}, "steps was 30, is 31"),
            ({"seed": 4}, "seed was 0, is 4"),
            ({"threads": 2}, "threads was 1, is 2"),
            ({"loss": {"projection": 1e4, "cycle": 3.0}}, r"loss\.cycle was 100\.0, is 3\.0"),
        ],
        ids=str,
    )
    def test_other_options_are_named(self, tmp_path: Path, change: dict[str, Any], words: str) -> None:
        output = tmp_path / "a.ndf"
        with pytest.raises(KeyboardInterrupt):
            fit(output, pressing(5))
        with pytest.raises(ResumeError, match=words):
            fit(output, resume=True, **change)
        fit(output, resume=True, checkpoint_seconds=3.0)  # which changes nothing

    def test_other_input_and_damage(self, tmp_path: Path) -> None:
        output = tmp_path / "a.ndf"
        with pytest.raises(KeyboardInterrupt):
            fit(output, pressing(5))
        with pytest.raises(ResumeError, match="input was 'a5a5"):
            fit(output, sphere_surface(fingerprint="b6" * 32), resume=True)
        path = checkpoint_path(output)
        data = bytearray(path.read_bytes())
        data[-100] ^= 1
        path.write_bytes(data)
        with pytest.raises(ResumeError, match="damaged; remove it and start without --resume"):
            fit(output, resume=True)
        assert not output.exists()
        fit_bytes(output)  # without --resume it does not matter

    def test_a_fit_that_fails_keeps_its_last_good_checkpoint(self, tmp_path: Path) -> None:
        output, count = tmp_path / "a.ndf", 0

        def late(query: Tensor, answer: Projection) -> Projection:
            nonlocal count
            count += 1
            return overflows(query, answer) if count > 20 else answer

        whole = fit_bytes(output)
        with pytest.raises(FitError, match="not finite"):
            fit(output, sphere_surface(Altered(SphereProjector(), late)), checkpoint_seconds=1e-9)
        assert not output.exists()
        recorder = Recorder()
        run_fit(sphere_surface(), tiny_config(), output=output, resume=True, observer=recorder)
        assert recorder.messages == ["resumed at step 20 of 30"]
        assert output.read_bytes() == whole


class TestReport:
    def test_what_was_done(self, tmp_path: Path) -> None:
        output, recorder = tmp_path / "a.ndf", Recorder()
        result = run_fit(sphere_surface(), tiny_config(), output=output, observer=recorder)
        report = json.loads(json.dumps(result.report))
        stages = ["base mesh", "initialise", "train", "quantise", "measure", "write"]
        assert recorder.stages == stages
        assert set(report["seconds"]) == {name.replace(" ", "_") for name in stages} | {"total"}
        assert report["representation"] == "sphere" and report["steps"] == 30
        assert (report["base_mesh"]["faces"], report["base_mesh"]["vertices"]) == (80, 42)
        assert (report["base_mesh"]["genus"], report["base_mesh"]["components"]) == (0, 1)
        assert report["asset_bytes"] == output.stat().st_size
        assert report["converged"] == 1.0
        assert (report["projected"], report["left_out"], report["pulled"]) == (30 * 200, 0, 0)
        assert report["longest_side"] == pytest.approx(2 * RADIUS, rel=0.06)
        assert report["projection_rms"] == pytest.approx(
            report["projection_rms_relative"] * report["longest_side"], rel=1e-6
        )

    def test_errors_are_those_of_the_file(self, tmp_path: Path) -> None:
        """Distances of decoded points from the sphere, in input units."""
        output = tmp_path / "a.ndf"
        report = fit(output, steps=200).report
        asset = Asset.load(output)
        rng = np.random.default_rng(3)
        areas = np.linalg.norm(
            np.cross(*np.diff(asset.content.vertices[asset.content.faces], axis=1).swapaxes(0, 1)), axis=1
        )
        faces = rng.choice(80, 4000, p=areas / areas.sum()).astype(np.int32)
        points = asset.map_points(faces, rng.dirichlet((1.0, 1.0, 1.0), 4000))
        rms = np.sqrt(((np.linalg.norm(points - np.array(CENTER), axis=1) - RADIUS) ** 2).mean())
        assert report["projection_rms"] == pytest.approx(rms, rel=0.15)
        assert asset.content.provenance["error"]["field_to_surface"]["rms"] == pytest.approx(
            report["projection_rms_relative"], rel=1e-3
        )

    def test_no_steps_is_the_base_mesh(self) -> None:
        asset = fit(None, steps=0).asset
        faces, weights = np.arange(80, dtype=np.int32), np.full((80, 3), 1 / 3)
        expected = asset.content.vertices[asset.content.faces].mean(axis=1)
        np.testing.assert_allclose(asset.evaluate(faces, weights), expected, atol=1e-6)

    def test_surfaces_that_cannot_be_sampled(self, tmp_path: Path) -> None:
        """And genus 1."""
        report = fit(tmp_path / "a.ndf", torus_surface()).report
        assert report["error"]["surface_to_field"] is None
        assert report["base_mesh"]["genus"] == 1
        assert Asset.load(tmp_path / "a.ndf").info()["base_mesh"]["genus"] == 1

    def test_without_the_inverse(self, tmp_path: Path) -> None:
        result = fit(tmp_path / "a.ndf", keep_inverse=False)
        assert list(result.asset.content.fields) == ["displacement"]
        assert result.report["cycle_loss"] is None


PULLED: dict[str, Any] = {"loss": {"projection": 1e4, "cycle": 1e2, "anchor": 1e5}, "steps": 60}
START = np.array(CENTER) + np.array([0.0, 0.0, RADIUS])
TARGET = np.array(CENTER) + RADIUS * np.array([np.sin(0.4), 0.0, np.cos(0.4)])


class TestAnchors:
    def file(self, folder: Path, name: str = "pairs.csv") -> str:
        """A point near the middle of a face is to go to one 0.4 radians beside it on the sphere."""
        path = folder / name
        path.write_text(",".join(repr(float(x)) for x in [*START, *TARGET]) + "\n")
        return str(path)

    def test_they_pull(self, tmp_path: Path) -> None:
        def distance(asset: Asset) -> float:
            corners = asset.to_input(asset.content.vertices)[asset.content.faces]
            face = int(np.linalg.norm(corners.mean(axis=1) - START, axis=1).argmin())
            grid = np.random.default_rng(0).dirichlet((1.0, 1.0, 1.0), 500)
            places = np.einsum("nc,cx->nx", grid, corners[face])
            nearest = grid[np.linalg.norm(places - START, axis=1).argmin()]
            mapped = asset.map_points(np.array([face], dtype=np.int32), nearest[None])
            return float(np.linalg.norm(mapped - TARGET))

        free = distance(fit(None, steps=60).asset)
        assert distance(fit(None, anchors=self.file(tmp_path), **PULLED).asset) < 0.4 * free

    def test_known_by_their_numbers_not_by_their_path(self, tmp_path: Path) -> None:
        """The asset holds no path, and a file that was changed is another run."""
        output = tmp_path / "a.ndf"
        first = fit_bytes(output, anchors=self.file(tmp_path, "one.csv"), **PULLED)
        assert fit_bytes(output, anchors=self.file(tmp_path, "two.csv"), **PULLED) == first
        asset = fit(output, anchors=self.file(tmp_path), **PULLED).asset
        assert str(tmp_path) not in json.dumps(asset.content.provenance)
        output.unlink()
        with pytest.raises(KeyboardInterrupt):
            fit(output, pressing(3), anchors=self.file(tmp_path), **PULLED)
        (tmp_path / "pairs.csv").write_text("0,0,0,1,1,1\n")
        with pytest.raises(ResumeError, match="anchors was"):
            fit(output, resume=True, anchors=str(tmp_path / "pairs.csv"), **PULLED)

    def test_a_weight_without_a_file(self) -> None:
        with pytest.raises(ConfigError, match=r"--loss\.anchor: there are no anchors to weigh"):
            fit(None, **PULLED)

    def test_without_a_weight_it_is_the_papers(self, tmp_path: Path) -> None:
        """A tenth of lambda_P (App. D.1); 0 weighs nothing."""
        file, steps = self.file(tmp_path), {"steps": 20}

        def largest(anchor: float | None) -> float:
            loss = {"projection": 1e4, "cycle": 1e2, "anchor": anchor}
            return fit(None, anchors=file, loss=loss, **steps).report["anchors"]["largest"]

        assert largest(None) == largest(1e3) < largest(0.0)


def test_the_paper_recipe(tmp_path: Path) -> None:
    """App. A.1, with fewer steps and samples."""
    few = {"steps": 12, "identity_steps": 8, "batch": 500, "faces": 100, "threads": 1, "encoding_levels": 4}
    config = resolve_config(given=Given(fit={"recipe": "paper", **few})).fit.config
    assert (config.sampling, config.optimizer, config.schedule) == ("rejection", "adam", "constant")
    report = run_fit(sphere_surface(), config, output=tmp_path / "a.ndf").report
    assert report["steps"] == 12
    assert report["projection_rms_relative"] < 0.1
    assert Asset.load(tmp_path / "a.ndf").content.provenance["config"]["recipe"] == "paper"


def test_without_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ConfigError, match="--device cuda: this torch sees no CUDA device; use --device cpu"):
        fit(None, device="cuda")
    assert fit(None, device="auto", steps=1).report["device"] == "cpu"


@pytest.mark.parametrize(("batch", "workers"), [(200, 1), (3072, 2)])
def test_threads_of_a_large_machine_wait_for_each_other(
    monkeypatch: pytest.MonkeyPatch, batch: int, workers: int
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 64)
    assert fit(None, threads=0, batch=batch, steps=2).report["threads"] == workers
    assert fit(None, threads=5, batch=batch, steps=2).report["threads"] == 5


def test_torch_threads_are_given_back() -> None:
    before = torch.get_num_threads()
    fit(None, steps=1)
    with pytest.raises(FitError):
        fit(None, sphere_surface(Altered(SphereProjector(), overflows)))
    assert torch.get_num_threads() == before
