"""`ndf fit` around a fit that is faked: options, messages, exit codes, what is printed where, what is left behind."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from ndf_core.cli import main
from ndf_core.config.fit import FitConfig
from ndf_core.errors import FitError
from ndf_core.fitting.observer import TrainingProgress

if TYPE_CHECKING:
    from tests.conftest import PluginMaker

pytestmark = pytest.mark.filterwarnings("error")


@dataclass
class FakePipeline:
    """Stands in for `ndf_core.fitting.pipeline`; `then` may raise."""

    then: Callable[[Path], None] = lambda output: None
    calls: list[dict[str, Any]] = field(default_factory=list)

    def run_fit(self, surface: Any, config: FitConfig, *, output: Path, resume: bool, observer: Any) -> Any:
        self.calls.append({"surface": surface, "config": config, "output": output, "resume": resume})
        os.write(1, b"a C library prints\n")
        print("python prints")
        if observer is not None:
            observer.stage("train")
            observer.progress(TrainingProgress(300, 1500, 1.25e-4, 3.1e-6, 123_456.0, 125.0))
            observer.message("a message")
        self.then(output)
        output.write_bytes(b"asset")
        return SimpleNamespace(
            report={"representation": surface.representation, "asset_bytes": 5, "ratio": float("nan")}
        )


@pytest.fixture
def pipeline(plugin_maker: PluginMaker, monkeypatch: pytest.MonkeyPatch) -> FakePipeline:
    fake = FakePipeline()
    module = ModuleType("ndf_core.fitting.pipeline")
    module.__dict__["run_fit"] = fake.run_fit
    monkeypatch.setitem(sys.modules, "ndf_core.fitting.pipeline", module)
    plugin_maker.add("blob", version="4.2")
    plugin_maker.add("other", confidence=0.1)  # with the same options
    return fake


@pytest.fixture
def blob(tmp_path: Path) -> str:
    path = tmp_path / "thing.blob"
    path.write_text("blob")
    return str(path)


@pytest.fixture
def asset(tmp_path: Path) -> str:
    return str(tmp_path / "out.ndf")


def test_json_is_one_object_on_stdout_whoever_prints(
    pipeline: FakePipeline, blob: str, asset: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", blob, "-o", asset, "--json"]) == 0
    out, err = capfd.readouterr()
    assert json.loads(out) == {"representation": "blob", "asset_bytes": 5, "ratio": None}
    for line in ("a C library prints", "python prints", "opening on stdout", "a note", "a message", "train ..."):
        assert line in err.splitlines()
    assert "read as blob: starts with the word blob" in err
    assert "step  300/1500  projection rms 1.25e-04  cycle 3.10e-06  123k samples/s  2:05 left" in err


def test_quiet_keeps_stderr_empty_of_progress(
    pipeline: FakePipeline, blob: str, asset: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", blob, "-o", asset, "--quiet"]) == 0
    assert capfd.readouterr().err == ""


def test_options_of_both_models_reach_the_run_and_the_plugin(pipeline: FakePipeline, blob: str, asset: str) -> None:
    arguments = ["--faces", "500", "--feature-dim=8", "--loss.projection", "7", "--resume", "--seed", "3"]
    mine = ["--resolution", "9", "--corner", "-1,-2,-3.5", "--no-closed", "--blob.steps", "4"]
    assert main(["fit", *mine, blob, "-o", asset, *arguments]) == 0
    call = pipeline.calls[0]
    config: FitConfig = call["config"]
    assert (config.faces, config.feature_dim, config.seed, config.loss.projection) == (500, 8, 3, 7.0)
    assert config.loss.cycle == 1e5, "the plugin's training default"
    assert call["resume"] is True
    assert call["surface"].fingerprint == "blob 9"


def test_the_config_file_may_name_the_representation(
    pipeline: FakePipeline, blob: str, asset: str, tmp_path: Path
) -> None:
    file = tmp_path / "fit.toml"
    file.write_text('repr = "blob"\n[fit]\nsteps = 5\n[fit.loss]\ncycle = 3\n[representation]\nresolution = 11\n')
    assert main(["fit", blob, "-o", asset, "--config", str(file), "--steps", "6"]) == 0
    call = pipeline.calls[0]
    assert (call["config"].steps, call["config"].loss.cycle, call["surface"].fingerprint) == (6, 3.0, "blob 11")


def test_three_wrong_values_are_one_error_before_anything_is_opened(
    pipeline: FakePipeline, blob: str, asset: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fit.toml"
    file.write_text('[fit]\nsteps = -5\nfaces = "x"\n[representation]\nresolution = 1\n')
    assert main(["fit", blob, "-o", asset, "--config", str(file), "--json"]) == 2
    out, err = capfd.readouterr()
    for key in ("fit.steps", "fit.faces", "representation.resolution"):
        assert f"{file}: {key}: " in err
    assert json.loads(out)["exit_code"] == 2
    assert "opening on stdout" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fit.toml", "site", "thing.blob"]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["-o", "{asset}"], 2, "Missing argument 'INPUT'"),
        (["{blob}"], 2, "Missing option '-o'"),
        (["{blob}", "-o", "{asset}", "--fcaes", "3"], 2, "No such option"),
        (["--fcaes", "3", "{blob}", "-o", "{asset}"], 2, "No such option"),
        (["{blob}", "-o", "{asset}", "--faces"], 2, "requires an argument"),
        (["{blob}", "-o", "{asset}", "--faces", "3"], 2, "command line: --faces: input should be greater"),
        (["{blob}", "-o", "{asset}", "--repr", "blub"], 2, "did you mean blob?"),
        (["{blob}", "-o", "{asset}", "--config", "none.toml"], 2, "none.toml: cannot be read as a config file"),
        (["{blob}", "-o", "{folder}/none/x.ndf"], 2, "there is no folder"),
        (["{blob}", "-o", "{folder}/x.ply"], 2, "the output must end in .ndf"),
        (["{blob}", "-o", "{folder}/taken.ndf"], 2, "there is a folder of this name"),
        (["{blob}.none", "-o", "{asset}"], 3, "there is no such file"),
        (["{folder}/bad.blob", "-o", "{asset}"], 3, "is bad"),
        (["{folder}/crash.blob", "-o", "{asset}"], 3, "ZeroDivisionError: of a sloppy author"),
        (["{folder}", "-o", "{asset}", "--repr", "blob"], 3, "Is a directory"),
        (["{folder}", "-o", "{asset}"], 2, "no installed representation recognises this"),
    ],
)  # fmt: skip
def test_bad_input_is_one_message_an_exit_code_and_nothing_else(
    pipeline: FakePipeline,
    blob: str,
    asset: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    message: str,
) -> None:
    (tmp_path / "taken.ndf").mkdir()
    (tmp_path / "bad.blob").write_text("blob bad")
    (tmp_path / "crash.blob").write_text("blob crash")
    before = sorted(tmp_path.rglob("*"))
    filled = [word.format(blob=blob, asset=asset, folder=tmp_path) for word in arguments]
    assert main(["fit", *filled]) == code
    err = capfd.readouterr().err
    assert message in err
    assert "Traceback" not in err
    assert pipeline.calls == []
    assert [path for path in sorted(tmp_path.rglob("*")) if "__pycache__" not in path.parts] == before


def test_debug_shows_the_traceback_where_it_is_wanted(
    pipeline: FakePipeline, tmp_path: Path, asset: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "crash.blob").write_text("blob crash")
    for arguments in (["--debug", "fit"], ["fit", "--debug"]):
        assert main([*arguments, str(tmp_path / "crash.blob"), "-o", asset]) == 3
        assert "ZeroDivisionError: of a sloppy author" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (FitError("the losses are not finite"), 3, "error: the losses are not finite"),
        (OSError(28, "No space left on device", "out.ndf"), 3, "error: out.ndf: No space left on device"),
        (MemoryError(), 3, "error: out of memory"),
        (ModuleNotFoundError("No", name="torch"), 3, "error: this needs torch, which is not installed: pip install"),
        (AttributeError("oops"), 1, "error: a fault of ndf itself, please report it: AttributeError: oops"),
    ],
)
def test_failures_of_the_run(
    pipeline: FakePipeline,
    blob: str,
    asset: str,
    capfd: pytest.CaptureFixture[str],
    error: Exception,
    code: int,
    message: str,
) -> None:
    def fail(_output: Path) -> None:
        raise error

    pipeline.then = fail
    assert main(["fit", blob, "-o", asset, "--json"]) == code
    out, err = capfd.readouterr()
    assert message in err
    assert "Traceback" not in err
    assert json.loads(out)["exit_code"] == code


def test_an_interrupt_says_how_to_go_on(
    pipeline: FakePipeline, blob: str, asset: str, capfd: pytest.CaptureFixture[str]
) -> None:
    def interrupt(output: Path) -> None:
        raise KeyboardInterrupt

    def leave_a_checkpoint(output: Path) -> None:
        Path(f"{output}.checkpoint").touch()
        raise KeyboardInterrupt

    pipeline.then = interrupt
    assert main(["fit", blob, "-o", asset]) == 130
    assert "interrupted before the first checkpoint" in capfd.readouterr().err
    pipeline.then = leave_a_checkpoint
    assert main(["fit", blob, "-o", asset]) == 130
    assert f"interrupted; go on with: ndf fit {blob} -o {asset} --resume" in capfd.readouterr().err
    pipeline.then = lambda output: None
    assert main(["fit", blob, "-o", asset]) == 0
    assert f"{asset}.checkpoint: left by an interrupted run" in capfd.readouterr().err
    assert main(["fit", blob, "-o", asset, "--resume"]) == 0
    assert "left by an interrupted run" not in capfd.readouterr().err


def test_help_shows_the_plugins_options_bounds_and_effective_defaults(
    pipeline: FakePipeline, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "118")
    assert main(["fit", "--repr", "blob", "--recipe", "paper", "--help"]) == 0
    text = " ".join(capfd.readouterr().out.split())
    assert "Options of --repr blob (A made-up representation):" in text
    assert "--resolution INTEGER grid points per side [default: 64; >= 2, <= 1024]" in text
    assert "--blob.steps INTEGER Newton steps [default: 7; > 0]" in text
    assert "--closed / --no-closed whether the surface is closed [default: True]" in text
    assert "--recipe [fast|paper]" in text
    cycle, steps = text.partition("--loss.cycle NUMBER")[2], text.partition("--steps INTEGER")[2]
    assert cycle.partition("default: ")[2].startswith("100000;"), "the plugin's"
    assert steps.partition("default: ")[2].startswith("10000;"), "the recipe's"


def test_help_without_a_representation_names_those_installed(
    pipeline: FakePipeline, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "--help"]) == 0
    out = capfd.readouterr().out
    assert "Options of a representation" in out
    assert "blob" in out
    assert "--faces" in out
