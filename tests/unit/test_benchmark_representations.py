"""The arithmetic of `benchmarks/representations.py`: which refusals are right, rows, what a picture shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_scripts import script

from ndf_core.render.camera import Camera

representations = script("representations")
pictures = script("representation_pictures")

SIDE = {"mean": 1e-4, "rms": 2e-4, "p99": 5e-4}


def row(**changes: Any) -> dict[str, Any]:
    figures = {"field_to_surface": SIDE, "surface_to_field": None, "manifold": True, "closed": False}
    counts = {"genus": 3, "components": 1, "folded_area": 1e-5, "bytes": 12_345, "converged": 0.99951}
    return {"representation": "soup", "cpu": 61.4, "wall": 40.0, **figures, **counts, **changes}


@pytest.mark.parametrize(("name", "right"), [("nerf/krrish_fern.ckpt", True), ("neural/niq_fox.npz", False)])
def test_only_files_without_a_surface_may_be_refused(
    name: str, right: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = representations.Run(3, "", "note\nerror: it has\nno surface\n", 2.0, 1.0)
    monkeypatch.setattr(representations, "run", lambda words, limit: ended)
    found = representations.measured(Path(name), name, tmp_path, 1, 60.0)
    assert (found["refused"], found["expected"]) == ("error: it has no surface", right)


def test_a_fit_that_takes_too_long_is_no_refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    late = representations.Run(None, "", "", 60.0, 58.0)
    monkeypatch.setattr(representations, "run", lambda words, limit: late)
    found = representations.measured(Path("nerf/krrish_fern.ckpt"), "nerf/krrish_fern.ckpt", tmp_path, 1, 60.0)
    assert (found["refused"], found["expected"]) == ("fit: not done after 60 s", False)


def test_the_table_names_what_is_missing() -> None:
    refused = {"cpu": 4.0, "wall": 5.0, "refused": "error: none", "expected": True}
    lines = representations.table({"soup/b.obj": row(), "neural/a.h5": refused}).splitlines()
    assert lines[2].startswith("| - | a.h5 | 4 | 5 | refused, as is right: error: none")
    assert "| 0.9995 | 1.0e-04, 2.0e-04 | - | yes, **no** | 3, 1 | 1.0e-05 | 12,345 |" in lines[3]
    assert len(lines[0].split("|")) == len(lines[3].split("|"))


def test_what_faces_away_of_a_closed_surface_is_hidden() -> None:
    points = np.array([[0.0, 0.0, 1.0], [0.5, 0.5, 1.0]])
    normals = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    camera = Camera.framing(np.array([[-1.0, -1, -1], [1, 1, 1]]), (0, 0))
    dots = pictures.Dots(points, None, normals, "two", closed=True)
    drawn = (pictures.paint(dots, camera) < 255).any(axis=2)
    assert drawn.sum() == 9, "one square of three by three"
    assert (pictures.paint(dots._replace(closed=False), camera) < 255).any(axis=2).sum() == 18
