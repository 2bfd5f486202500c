"""Exporters and observers: plugins beside representations, and what happens when they fail."""

from __future__ import annotations

import itertools
import json
import sys
import threading
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from small_assets import small_content, torus
from small_surfaces import sphere_surface, tiny_config

from ndf_core.asset.asset import Asset
from ndf_core.cli import main
from ndf_core.errors import ConfigError, OutputError, PluginError
from ndf_core.fitting import observer as observer_module
from ndf_core.fitting.observer import Observer, Observers, TrainingProgress
from ndf_core.fitting.observer_thread import InThread
from ndf_core.fitting.pipeline import run_fit
from ndf_core.plugins.companions import export, open_observers
from ndf_core.plugins.discovery import entries

EXPORTER = """
from ndf_core.api import ExporterSpec, hookimpl


@hookimpl
def ndf_exporter():
    return ExporterSpec(name="count", summary="numbers of a mesh", write="companion:write", api_version=1)


def write(file, mesh, colors):
    print("noise")
    file.write(f"{len(mesh.vertices)} {len(mesh.faces)} {colors is not None}".encode())
"""
OBSERVER = """
from ndf_core.api import ObserverSpec, hookimpl
from ndf_core.fitting import observer as observer_module
from ndf_core.fitting.observer import Observer


@hookimpl
def ndf_observer():
    return ObserverSpec(name="count", summary="counts", open="companion:Counter", api_version=1)


class Counter(Observer):
    def __init__(self, target):
        self.target = target

    def stage(self, name):
        raise RuntimeError("out of\\ndisk " + self.target)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Of a distribution with one module, `companion`."""
    info = tmp_path / "strange_thing-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strange-thing\nVersion: 2.0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    entries.cache_clear()
    yield tmp_path
    entries.cache_clear()
    sys.modules.pop("companion", None)


def offer(folder: Path, group: str, source: str, name: str = "count") -> None:
    (folder / "companion.py").write_text(source)
    (folder / "strange_thing-2.0.dist-info" / "entry_points.txt").write_text(f"[{group}]\n{name} = companion\n")


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    path = tmp_path / "torus.ndf"
    Asset(small_content(torus(), amplitude=0.01)).save(path)
    return path


def test_ndf_extract_writes_what_a_plugin_offers(
    folder: Path, asset: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    offer(folder, "ndf.exporters", EXPORTER)
    output = folder / "mesh.count"
    assert main(["extract", str(asset), "-o", str(output), "--edge-length", "0.3", "--json"]) == 0
    report = json.loads(capfd.readouterr().out)
    assert output.read_text().split()[:2] == [str(report["vertices"]), str(report["faces"])]
    assert main(["plugins", "--kind", "exporters", "--check"]) == 0
    assert capfd.readouterr().out == "count              ok      strange-thing 2.0\n"


@pytest.mark.parametrize(
    ("old", "new", "kind", "message"),
    [
        ("print(", "raise OSError('no space')  # (", OutputError, "OSError: no space"),
        ("api_version=1", "api_version=7", PluginError, "speaks plugin API version 7, this ndf-core 1"),
        ("companion:write", "companion:right", PluginError, "has no attribute 'right'"),
        ("companion:write", "companion", PluginError, "write must look like 'package.module:function'"),
        ('name="count"', 'name="other"', PluginError, "called 'count' but the exporter 'other'"),
        ("@hookimpl\n", "", PluginError, "no @hookimpl function ndf_exporter"),
        ("return ExporterSpec(", "return dict(", PluginError, "returned dict, not an ExporterSpec"),
        ("@hookimpl", "import no_such\n@hookimpl", PluginError, "No module named 'no_such'"),
    ],
)
def test_a_failing_exporter_is_one_line_and_leaves_no_file(
    folder: Path, asset: Path, old: str, new: str, kind: type[Exception], message: str
) -> None:
    assert old in EXPORTER
    offer(folder, "ndf.exporters", EXPORTER.replace(old, new, 1))
    with pytest.raises(kind) as caught:
        export(folder / "mesh.count", Asset.load(asset).extract(0.5))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (folder / "mesh.count").exists()


def test_nobody_replaces_what_ndf_writes_itself(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    offer(folder, "ndf.exporters", EXPORTER, name="ply")
    assert main(["plugins", "--kind", "exporters"]) == 0
    assert "ply                broken  strange-thing 2.0  ndf-core itself offers this name" in capfd.readouterr().out


class Recorder(Observer):
    """Keeps what it hears."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, Any]] = []

    def start(self, run: Any) -> None:
        self.heard.append(("start", run))

    def message(self, text: str) -> None:
        self.heard.append(("message", text))

    def finish(self, report: Any) -> None:
        self.heard.append(("finish", report))


def test_a_failing_observer_is_reported_once_and_never_stops_a_fit(folder: Path) -> None:
    offer(folder, "ndf.observers", OBSERVER)
    (counter,) = open_observers(["count:somewhere:else"])
    recorder = Recorder()
    result = run_fit(sphere_surface(), tiny_config(steps=3), observer=Observers([counter, recorder]))
    (line,) = [text for event, text in recorder.heard if event == "message" and "count" in text]
    assert line == "the observer count failed and is left out: RuntimeError: out of disk somewhere:else"
    assert recorder.heard[0][1]["config"]["steps"] == 3
    assert recorder.heard[-1] == ("finish", result.report)


def test_a_failing_observer_with_nobody_else_to_tell_is_told_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    class Leaver(Observer):
        def stage(self, name: str) -> None:
            raise SystemExit(3)

    guarded = Observers.of(Leaver())
    guarded.stage("train")
    guarded.stage("write")
    assert capsys.readouterr().err == "the observer Leaver failed and is left out: SystemExit: 3\n"
    assert Observers.of(guarded) is guarded


def test_one_thread_makes_and_calls_a_plugins_observer() -> None:
    class Threads(Observer):
        def __init__(self) -> None:
            self.seen = [threading.get_ident()]

        def message(self, text: str) -> None:
            self.seen.append(threading.get_ident())

    made: list[Threads] = []
    following = InThread("threads", lambda: made.append(Threads()) or made[0])
    following.message("hello")
    following.message("again")
    assert len(made[0].seen) == 3
    assert len({*made[0].seen}) == 1
    assert made[0].seen[0] != threading.get_ident()


def test_an_observer_that_hangs_is_reported_once_and_the_fit_goes_on() -> None:
    class Hanging(Observer):
        def stage(self, name: str) -> None:
            threading.Event().wait()

    recorder = Recorder()
    hanging = InThread("hanging", Hanging, seconds=0.2)
    run_fit(sphere_surface(), tiny_config(steps=3), observer=Observers([hanging, recorder]))
    (line,) = [text for event, text in recorder.heard if event == "message" and "hanging" in text]
    assert line == "the observer hanging failed and is left out: TimeoutError: stage did not return within 0.2 s"
    with pytest.raises(TimeoutError, match="an earlier call has not returned"):
        hanging.finish(None)


def test_an_observers_own_timeout_is_told_as_its_own() -> None:
    class Timing(Observer):
        def stage(self, name: str) -> None:
            raise TimeoutError("no server")

    with pytest.raises(TimeoutError, match="no server"):
        InThread("timing", Timing).stage("train")


def test_a_slow_observer_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(Observer):
        def stage(self, name: str) -> None:
            time.sleep(0.03)

    monkeypatch.setattr(observer_module, "SLOW_SECONDS", 0.05)
    recorder = Recorder()
    observers = Observers([recorder, Slow()])
    for name in ("base mesh", "initialise", "train", "quantise", "measure"):
        observers.stage(name)
    ((_, line),) = recorder.heard
    assert line.startswith("the observer Slow holds the fit up: 0.")


def test_an_interrupt_passes_and_a_failed_fit_finishes_without_a_report() -> None:
    class Impatient(Recorder):
        def stage(self, name: str) -> None:
            raise KeyboardInterrupt

    impatient = Impatient()
    with pytest.raises(KeyboardInterrupt):
        run_fit(sphere_surface(), tiny_config(), observer=impatient)
    assert impatient.heard[-1] == ("finish", None)


def test_json_lines_tell_the_whole_run(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    (observer,) = open_observers([f"jsonl:{path}"])
    report = run_fit(sphere_surface(), tiny_config(), observer=observer).report
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    events = [line["event"] for line in lines]
    assert (events[0], events[-1]) == ("start", "finish")
    stages = [line["name"] for line in lines if line["event"] == "stage"]
    assert stages[:3] == ["base mesh", "initialise", "train"]
    assert lines[0]["representation"] == "sphere"
    last = [line for line in lines if line["event"] == "progress"][-1]
    assert (last["step"], last["total"]) == (30, 30)
    assert lines[-1]["report"]["projection_rms"] == report["projection_rms"]
    assert all(a["seconds"] <= b["seconds"] for a, b in itertools.pairwise(lines))


def test_numbers_that_json_lacks_become_null(tmp_path: Path) -> None:
    (observer,) = open_observers([f"jsonl:{tmp_path / 'x.jsonl'}"])
    observer.progress(TrainingProgress(1, 2, float("nan"), np.inf, 3.0, 4.0))
    observer.finish({"NaN": "NaN"})
    first, second = (tmp_path / "x.jsonl").read_text().splitlines()
    assert json.loads(first)["projection_rms"] is None
    assert json.loads(second)["report"] == {"NaN": "NaN"}


@pytest.mark.parametrize(
    ("wanted", "kind", "message"),
    [
        ("jsnol", ConfigError, r"there is no observer 'jsnol'; did you mean jsonl\?"),
        ("jsonl:none/x", OutputError, "none/x: cannot be written: No such file"),
    ],
)
def test_an_observer_that_cannot_be_had_is_said_before_the_fit(
    wanted: str, kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message):
        open_observers([wanted])


@pytest.mark.parametrize(
    ("name", "module", "working"),
    [("tensorboard", "torch.utils.tensorboard", "tensorboard_log"), ("wandb", "wandb", "wandb_run")],
)
def test_the_extras_say_how_to_install_them(
    name: str, module: str, working: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, f"ndf_core.observers.{working}", raising=False)
    said = (
        rf"observer {name}: the plugin ndf-core .* cannot be used: .* not installed: pip install 'ndf-core\[{name}\]'"
    )
    with pytest.raises(PluginError, match=said):
        open_observers([name])
    assert main(["plugins", "--kind", "observers", "--check"]) == 0
    answer = capfd.readouterr().out
    assert (f"pip install 'ndf-core[{name}]'" in answer) == (find_spec(name) is None)


class Calls:
    """Stands in for a logger's API: keeps every call, answers with itself."""

    def __init__(self) -> None:
        self.made: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Any:
        if name == "summary":
            return self

        def call(*words: Any, **options: Any) -> Calls:
            self.made.append((name, words, options))
            return self

        return call


def test_losses_reach_tensorboard_and_wandb(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = Calls()
    board, wandb = ModuleType("torch.utils.tensorboard"), ModuleType("wandb")
    board.__dict__["SummaryWriter"], wandb.__dict__["init"] = calls.SummaryWriter, calls.init
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", board)
    monkeypatch.setitem(sys.modules, "wandb", wandb)
    for working in ("tensorboard_log", "wandb_run"):  # also forgotten afterwards: they hold the stand-ins
        monkeypatch.setitem(sys.modules, f"ndf_core.observers.{working}", ModuleType("none"))
        monkeypatch.delitem(sys.modules, f"ndf_core.observers.{working}")
    observers = open_observers(["tensorboard:logs", "wandb:shapes"])
    run_fit(sphere_surface(), tiny_config(), observer=Observers(observers))
    made = {name: (words, options) for name, words, options in calls.made}
    assert made["SummaryWriter"] == (("logs",), {})
    assert made["init"][1]["project"] == "shapes"
    assert made["add_scalar"][0][0] == "samples_per_second"
    assert made["log"][0][0].keys() == {"projection_rms", "cycle_loss", "samples_per_second"}
    assert made["log"][1] == {"step": 30}
    assert "projection_rms" in made["update"][0][0]
    assert made["finish"][1] == {"exit_code": 0}
    assert "close" in made
