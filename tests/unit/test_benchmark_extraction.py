"""The arithmetic of `benchmarks/extraction.py`: fronts, times to equal error, ratios at equal vertices."""

from __future__ import annotations

from typing import Any

import pytest
from benchmark_scripts import script

summary = script("extraction_summary")


def runs(*values: tuple[float, float], vertices: int = 100) -> list[dict[str, Any]]:
    return [
        {"method": "x", "size": 0.1, "vertices": vertices, "seconds": seconds, "error": error}
        for seconds, error in values
    ]


def test_the_front_is_what_no_other_beats() -> None:
    found = summary.front(runs((2.0, 0.5), (1.0, 1.0), (3.0, 0.7), (4.0, 0.1), (4.0, 0.2)))
    assert [(run["seconds"], run["error"]) for run in found] == [(1.0, 1.0), (2.0, 0.5), (4.0, 0.1)]


def test_time_to_an_error_is_interpolated_in_logarithms() -> None:
    line = runs((1.0, 1.0), (4.0, 0.25), (16.0, 0.0625), (20.0, 0.5))
    assert summary.time_to(0.5, line) == pytest.approx(2.0)
    assert summary.time_to(0.25, line) == pytest.approx(4.0)
    assert summary.time_to(2.0, line) == 1.0, "the fastest is better than asked"
    assert summary.time_to(0.01, line) is None


def test_dominated_points_lie_in_the_window_and_lose_both_ways() -> None:
    mine = runs((0.1, 1.0), (1.0, 0.5), (5.0, 0.1), (20.0, 0.01))
    theirs = runs((0.05, 0.5), (0.5, 0.4), (0.9, 0.3), (6.0, 0.05), (15.0, 0.001))
    found = summary.dominated(mine, theirs)
    assert [(one["ours"]["seconds"], one["by"]["seconds"]) for one in found] == [(1.0, 0.5)]


def test_speedups_compare_at_our_errors() -> None:
    found = summary.speedups(runs((1.0, 0.5), (2.0, 0.6), (4.0, 0.25), (8.0, 1e-3)), runs((10.0, 0.5), (40.0, 0.25)))
    assert [(one["ratio"], one["reached"]) for one in found] == [(10.0, True), (10.0, True), (5.0, False)]
    assert found[-1]["best_error_of_alternatives"] == 0.25


def test_error_ratio_at_equal_vertices() -> None:
    cubes = [{"vertices": n, "error": 100.0 / n} for n in (100, 1000, 10_000)]
    mine = [{"vertices": n, "error": 25.0 / n} for n in (10, 300, 3000, 100_000)]
    assert summary.error_ratio(mine, cubes) == pytest.approx(0.25)
    assert summary.error_ratio(mine[:1], cubes) is None


def test_the_summary_counts_extraction_solution_and_query() -> None:
    entry = {
        "method": "ours",
        "size": 0.1,
        "vertices": 200,
        "seconds": {"extract": 0.25, "geodesics": 1.0, "query": 0.125, "spectrum": 2.0},
        "geodesics_error": 0.02,
        "spectrum_error": 0.01,
        "vertices_on_surface": {},
    }
    cubes = [
        entry | {"method": "marching cubes", "vertices": n, "geodesics_error": 0.1, "spectrum_error": 0.02}
        for n in (100, 400)
    ]
    failed = {"method": "marching cubes + PyMeshLab", "size": 0.1, "vertices": 9, "seconds": {}, "failed": "no mesh"}
    result = {"shape": "a", "neural": True, "asset_bytes": 1, "reference": {}, "runs": [entry, *cubes, failed]}
    assert summary.total(entry, "geodesics") == 1.375
    assert summary.total(entry, "spectrum") == 2.25
    found = summary.summarise([result])
    ratios = found["median_error_ratio_to_marching_cubes_at_equal_vertices"]
    assert ratios == {"geodesics": pytest.approx(0.2), "spectrum": pytest.approx(0.5)}
    assert found["shapes"]["a"]["spectrum"]["dominated"] == []
