"""Opening trees: surfaces, fingerprints, options, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ndf_plugin_sdf.analytic import AnalyticConfig, sniff
from ndf_plugin_sdf.analytic_surface import open_analytic
from pydantic import ValidationError
from sdf_trees import BALL, BRACKET

from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.errors import InputError


def toml(tree: dict[str, Any]) -> str:
    lines = []
    for key, value in tree.items():
        shown = json.dumps(value) if not isinstance(value, float) or value != int(value) else f"{value:.1f}"
        lines.append(f"{key} = {shown}")
    return "\n".join(lines)


def test_the_bracket_gets_a_base_mesh_of_its_genus() -> None:
    surface = open_analytic(BRACKET, AnalyticConfig(resolution=96))
    counts = check_base_mesh(surface.base_mesh.extract(600))
    assert (counts.components, counts.genus) == (1, 2)
    assert counts.faces <= 600


def test_fingerprint_is_of_content_and_options(tmp_path: Path) -> None:
    def of(name: str, text: str, **options: Any) -> str:
        (tmp_path / name).write_text(text)
        return open_analytic(tmp_path / name, AnalyticConfig(**options)).fingerprint

    base = of("a.toml", toml(BALL))
    assert base == of("b.json", json.dumps(BALL, indent=3))
    assert base == of("c.toml", "# the same ball\n" + toml({"center": BALL["center"], "radius": 1, "type": "sphere"}))
    assert base != of("a.toml", toml({**BALL, "radius": 1.5}))
    assert base != of("a.toml", toml(BALL), resolution=128)
    assert len(base) == 64


def test_bounds_that_cut_the_solid_are_refused() -> None:
    for bounds in (((-0.5, -2, -2), (2, 2, 2)), ((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))):
        with pytest.raises(InputError, match="reaches the bounds|negative all over|nowhere zero"):
            open_analytic(BALL, AnalyticConfig(bounds=bounds))
    assert open_analytic(BALL, AnalyticConfig(bounds=((-2, -2, -2), (2, 2, 2)))).representation == "analytic"


@pytest.mark.parametrize(
    "options",
    [
        {"bounds": [[0, 0, 0], [0, 1, 1]]},
        {"bounds": [[0, 0, 0], [1, 1, float("inf")]]},
        {"bounds": [[0, 0], [1, 1]]},
        {"resolution": 3},
        {"corrections": -1},
        {"lipschitz": 0},
        {"nonsense": 1},
    ],
)
def test_options_out_of_bounds(options: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        AnalyticConfig(**options)


def test_sources_that_are_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a directory"):
        open_analytic(tmp_path, AnalyticConfig())
    with pytest.raises(InputError, match="need a file, module:callable, a function or a tree, not int"):
        open_analytic(7, AnalyticConfig())
    with pytest.raises(InputError, match="No such file"):
        open_analytic(tmp_path / "none.toml", AnalyticConfig())


@pytest.mark.parametrize("suffix", [".toml", ".json"])
@pytest.mark.parametrize("content", [b"", b"\0\xff" * 1000, bytes(range(256)) * 64])
def test_noise_is_one_clear_error(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"noise{suffix}"
    path.write_bytes(content)
    found = sniff(path)
    assert found is not None
    assert found.confidence == 0.3
    with pytest.raises(InputError):
        open_analytic(path, AnalyticConfig())


def test_sniffing_tells_trees_from_other_tables(tmp_path: Path) -> None:
    answers = {}
    for name, text in {
        "tree.toml": toml(BALL),
        "tree.json": json.dumps(BALL),
        "pyproject.toml": "[project]\nname = 'x'",
        "list.json": "[1]",
        "tree.txt": toml(BALL),
        "deep.json": "[" * 100_000,
    }.items():
        (tmp_path / name).write_text(text)
        found = sniff(tmp_path / name)
        answers[name] = found.confidence if found else None
    assert answers == {
        "tree.toml": 1.0,
        "tree.json": 1.0,
        "pyproject.toml": 0.3,
        "list.json": 0.3,
        "tree.txt": None,
        "deep.json": 0.3,
    }
    assert sniff(tmp_path) is None
    assert sniff(tmp_path / "none.toml") is None


def test_coordinates_of_any_size() -> None:
    for scale, offset in ((1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)):
        scaled = {"type": "scale", "factor": scale, "child": BALL}
        tree = {"type": "translate", "offset": [offset, 0, 0], "child": scaled}
        surface = open_analytic(tree, AnalyticConfig(resolution=32))
        base = surface.base_mesh.extract(200)
        assert check_base_mesh(base).genus == 0
        centre = np.array([offset, 0, 0]) + scale * np.array(BALL["center"])
        radius = np.linalg.norm(base.vertices - centre, axis=1) / scale
        np.testing.assert_allclose(radius, 1.0, atol=0.05)


def test_two_components_far_apart() -> None:
    tree = {
        "type": "union",
        "children": [{"type": "sphere", "radius": 1}, {"type": "sphere", "radius": 1, "center": [40, 0, 0]}],
    }
    counts = check_base_mesh(open_analytic(tree, AnalyticConfig()).base_mesh.extract(400))
    assert counts.components == 2
