"""Functions as surfaces: what they may take and return, how they are found, and how their failures are told."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from ndf_plugin_sdf.analytic import AnalyticConfig, names_callable, sniff
from ndf_plugin_sdf.analytic_surface import open_analytic

from ndf_core.errors import InputError
from ndf_core.interfaces import Surface

BOX = ((-1.5, -1.5, -1.5), (1.5, 1.5, 1.5))
CONFIG = AnalyticConfig(bounds=BOX)


def with_tensors(points: torch.Tensor) -> torch.Tensor:
    return torch.linalg.vector_norm(points, dim=1) - 1.0


def with_arrays(points: np.ndarray) -> np.ndarray:
    assert isinstance(points, np.ndarray)
    return np.linalg.norm(points, axis=1) - 1.0


def with_either(points: Any) -> Any:
    return (points**2).sum(1) ** 0.5 - 1.0


def in_single_precision(points: torch.Tensor) -> torch.Tensor:
    return torch.linalg.vector_norm(points.float(), dim=1) - 1.0


def in_single_precision_arrays(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.asarray(points, np.float32), axis=1) - np.float32(1)


def as_column(points: torch.Tensor) -> torch.Tensor:
    return with_tensors(points)[:, None]


def detached(points: torch.Tensor) -> torch.Tensor:
    return with_tensors(points).detach()


def changes_its_input(points: np.ndarray) -> np.ndarray:
    points *= 2
    return np.linalg.norm(points, axis=1) / 2 - 1.0


def not_a_distance(points: torch.Tensor) -> torch.Tensor:
    return ((points**2).sum(1) - 1.0) * 50.0


@pytest.mark.parametrize(
    "function",
    [with_tensors, with_arrays, with_either, in_single_precision, in_single_precision_arrays, as_column, detached,
     changes_its_input, not_a_distance],
)  # fmt: skip
def test_a_ball_in_many_ways(function: Callable[[Any], Any]) -> None:
    surface = open_analytic(function, CONFIG)
    directions = np.random.default_rng(0).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for distance in (0.8, 1.2):
        answer = surface.projector.project(torch.from_numpy(directions * distance))
        assert bool(answer.converged.all())
        tolerance = 1e-5 if "single" in function.__name__ else 1e-7
        np.testing.assert_allclose(answer.points.numpy(), directions, atol=tolerance)
        assert answer.normals is not None
        np.testing.assert_allclose(answer.normals.numpy(), directions, atol=1e-3)
    assert surface.sample is not None
    points, _ = surface.sample(1000, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=1e-5)


def raises(error: BaseException) -> Callable[[Any], Any]:
    def function(points: Any) -> Any:
        raise error

    return function


def test_a_function_that_raises_is_told_with_file_and_line() -> None:
    with pytest.raises(InputError) as caught:
        open_analytic(raises(KeyError("weights")), CONFIG)
    assert "KeyError: 'weights' (test_callables.py, line " in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda p: p, r"must return shape \(7,\) for points \(7, 3\), not \(7, 3\)"),
        (lambda p: p[0, 0], "must return shape"),
        (lambda p: p[:3, 0], "must return shape"),
        (lambda p: p[:, 0] > 0, "real numbers"),
        (lambda p: None, "must return"),
        (lambda p: "text", "must return"),
        (lambda p: p[:, 0] * float("nan"), "not finite|gives nan"),
        (lambda p: p[:, 0] * 0 + 1, "a constant"),
        (lambda p: 1 - (p**2).sum(1), "change its sign"),
        (lambda p: (p**2).sum(1) - 2.5, "reaches the bounds"),
        (lambda p: p[:, 0], "reaches the bounds"),
    ],
)
def test_answers_that_are_no_field(function: Callable[[Any], Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        open_analytic(function, CONFIG)


def test_not_a_number_somewhere_is_told_with_its_place() -> None:
    def hole(points: torch.Tensor) -> torch.Tensor:
        values = with_tensors(points)
        return torch.where(points[:, 0] > 1.4, torch.nan, values)

    with pytest.raises(InputError, match=r"gives nan at \(1\.\d+, .*must be finite everywhere"):
        open_analytic(hole, CONFIG)


def test_occupancies_are_refused_as_such() -> None:
    """A jump has no direction to go."""

    def occupancy(points: np.ndarray) -> np.ndarray:
        return np.where(np.linalg.norm(points, axis=1) < 1.0, -1.0, 1.0)

    with pytest.raises(InputError, match="is an occupancy, its gradient is zero"):
        open_analytic(occupancy, CONFIG)


def test_bounds_come_from_the_options_or_from_the_function() -> None:
    def ball(points: Any) -> Any:
        return with_either(points)

    with pytest.raises(InputError, match=r"--bounds '\[\["):
        open_analytic(ball, AnalyticConfig())
    vars(ball)["bounds"] = BOX
    assert isinstance(open_analytic(ball, AnalyticConfig()), Surface)
    for wrong in ([[0, 0, 0]], "box", [[1, 1, 1], [0, 0, 0]], [[0, 0, 0], [1, 1, float("inf")]]):
        vars(ball)["bounds"] = wrong
        with pytest.raises(InputError, match="`bounds` is not a box"):
            open_analytic(ball, AnalyticConfig())


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


MODULE = "def ball(p):\n    return (p**2).sum(1)**0.5 - 1.0\nball.bounds = [[-1.5]*3, [1.5]*3]\nradius = 3\n"


def test_modules_are_found_from_the_current_folder_and_as_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, "some_solids.py", MODULE)
    write(tmp_path, "sub/helper_of_solid.py", "SIZE = 1.0\n")
    write(tmp_path, "sub/solid.py", "from helper_of_solid import SIZE\n" + MODULE)
    monkeypatch.chdir(tmp_path)
    before = list(sys.path)
    for source in ("some_solids:ball", "sub/solid.py:ball", str(tmp_path / "sub" / "solid.py") + ":ball"):
        assert names_callable(source)
        found = sniff(Path(source))
        assert found is not None
        assert found.confidence == 0.6
        assert isinstance(open_analytic(source, AnalyticConfig()), Surface)
    assert sys.path == before


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("no_such_module_here:ball", "importing no_such_module_here failed: ModuleNotFoundError"),
        ("some_solids:cube", "some_solids has no 'cube'"),
        ("some_solids:radius", "'radius' is a int, not a function"),
        ("missing.py:ball", "there is no file missing.py"),
        ("broken.py:ball", "SyntaxError"),
        ("exits.py:ball", "SystemExit"),
        ("raises.py:ball", r"ZeroDivisionError: division by zero \(raises.py, line 2\)"),
    ],
)
def test_modules_that_cannot_be_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, words: str
) -> None:
    write(tmp_path, "some_solids.py", MODULE)
    write(tmp_path, "broken.py", "def ball(:\n")
    write(tmp_path, "exits.py", "import sys\nsys.exit(3)\n")
    write(tmp_path, "raises.py", "\n1 / 0\n")
    monkeypatch.chdir(tmp_path)
    sys.modules.pop("some_solids", None)
    with pytest.raises(InputError, match=words):
        open_analytic(source, AnalyticConfig())


def test_fingerprint_is_of_what_the_function_computes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    prints = []
    for text in (MODULE, MODULE, MODULE.replace("1.0", "1.1"), "# comment\n" + MODULE):
        write(tmp_path, "s.py", text)
        prints.append(open_analytic("s.py:ball", AnalyticConfig()).fingerprint)
    assert prints[0] == prints[1]
    assert len(set(prints)) == 3
