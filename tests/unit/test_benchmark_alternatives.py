"""The alternatives of `benchmarks/alternatives.py` are right where they should be: on an exact, thick sphere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_scripts import script
from small_assets import icosphere

from ndf_core.asset.asset import Asset

SPHERE = np.array([2.0] * 3 + [6.0] * 5 + [12.0] * 2)
"""l (l + 1)."""


@pytest.fixture(scope="module")
def alternatives() -> Any:
    return script("alternatives")


def ball(alternatives: Any) -> Any:
    vertices, faces = icosphere(5)
    points = np.random.default_rng(0).normal(size=(6000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)

    def closest(queries: np.ndarray) -> np.ndarray:
        queries = queries + np.array([1e-9, 0.0, 0.0])  # the middle has no closest point
        return queries / np.linalg.norm(queries, axis=1, keepdims=True)

    def no_fit(_folder: Path) -> Asset:
        raise AssertionError("nothing is fitted here")

    return alternatives.Case("ball", vertices, faces, points[:5000], closest, points[5000:], no_fit)


@pytest.mark.parametrize(("method", "eigenvalues", "heat"), [("points", 0.07, 0.05), ("grid", 0.01, 0.002)])
def test_on_the_sphere(alternatives: Any, method: str, eigenvalues: float, heat: float) -> None:
    case = ball(alternatives)
    true_values, true_solution = alternatives.truth(case)
    assert np.abs(true_values / SPHERE - 1).max() < 5e-3
    values, solution, _ = alternatives.by_points(case) if method == "points" else alternatives.by_grid(case, 16)
    assert np.abs(values / SPHERE - 1).mean() < eigenvalues
    assert ((solution - true_solution) ** 2).mean() < heat**2 * true_solution.var()
