"""`benchmarks/rate_distortion.py` and its baseline: the envelope, the ruler that both sides share, the cache."""

from __future__ import annotations

import json
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_scripts import script
from small_assets import icosphere, small_content, torus

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.errors import ConfigError
from ndf_core.meshio import write_mesh

baseline = script("qem_draco")
benchmark = script("rate_distortion")
accuracy = script("accuracy")
Point = baseline.Point


def points_of(*pairs: tuple[int, float]) -> list[Any]:
    return [Point(f"p{i}", size, rms, rms / 2) for i, (size, rms) in enumerate(pairs)]


def test_the_envelope_is_convex_and_below_every_point() -> None:
    rng = np.random.default_rng(0)
    size = np.exp(rng.uniform(6, 11, 300)).astype(int)
    points = points_of(*zip(size.tolist(), (rng.uniform(1, 3, 300) / size).tolist(), strict=True))
    best = baseline.lower_envelope(points)
    assert 3 < len(best) < 40 and set(best) <= set(points)
    slopes = [(b.rms - a.rms) / (b.bytes - a.bytes) for a, b in pairwise(best)]
    assert all(slope < 0 for slope in slopes) and slopes == sorted(slopes)
    for point in points:
        bound = baseline.rms_at(best, point.bytes)
        assert bound is None or bound <= point.rms * (1 + 1e-12)


def test_the_envelope_ignores_order_doubles_and_points_without_gain() -> None:
    points = points_of((100, 1.0), (100, 2.0), (200, 0.5), (200, 0.5), (300, 0.5), (400, 0.1), (150, 1.5))
    for order in (points, points[::-1]):
        assert [(p.bytes, p.rms) for p in baseline.lower_envelope(order)] == [(100, 1.0), (200, 0.5), (400, 0.1)]


def test_reading_the_envelope_follows_a_power_and_does_not_extrapolate() -> None:
    best = baseline.lower_envelope(points_of((100, 1.0), (400, 0.25), (1600, 0.0625)))
    assert baseline.rms_at(best, 200) == pytest.approx(0.5)
    assert baseline.rms_at(best, 9999) == pytest.approx(0.0625)  # a client may always take the smaller mesh
    assert baseline.rms_at(best, 99) is None
    assert baseline.bytes_at(best, 0.125) == pytest.approx(800)
    assert baseline.bytes_at(best, 0.06) is None and baseline.bytes_at(best, 1.1) is None
    assert baseline.rms_at([], 100) is None and baseline.bytes_at([], 0.1) is None


def test_two_sided_means_the_larger() -> None:
    assert Point("p", 1, 0.1, 0.2).rms == Point("p", 1, 0.2, 0.1).rms == 0.2


def test_both_sides_are_measured_with_the_same_ruler() -> None:
    """An asset that displaces nothing is its base mesh: both ways to its error agree."""
    asset = Asset(small_content(torus(16, 8), amplitude=0.0, scale=2.0, center=(3.0, 0.0, 0.0)))
    fine, faces = torus(64, 32)
    fine = fine * 2.1 + [3.0, 0.0, 0.0]
    figures = accuracy.measure_asset(asset, ndf_core.open((fine, faces), "mesh"), 20_000)
    low, high = fine.min(axis=0), fine.max(axis=0)
    side = float((high - low).max())
    coarse = (asset.to_input(asset.content.vertices) - (low + high) / 2) / side
    errors = baseline.Reference.of(fine, faces, 20_000).errors(coarse, asset.content.faces)
    for name, error in zip(accuracy.DIRECTIONS, errors, strict=True):
        assert figures[name]["rms"] * asset.longest_side / side == pytest.approx(error, rel=0.03)


def test_the_error_of_an_inscribed_sphere() -> None:
    """Concentric spheres: the distance is the difference of the radii, in shares of the larger one's side."""
    points, faces = icosphere(5)
    reference = baseline.Reference.of(points * 7 + 100, faces, 2_000)
    assert reference.errors(reference.vertices * 0.9, faces) == pytest.approx((0.05, 0.05), rel=2e-3)


def test_more_bits_cost_bytes_and_lower_the_error() -> None:
    points, faces = torus(64, 32)
    reference = baseline.Reference.of(points, faces, 5_000)
    (measured,) = baseline.sweep(reference, face_counts=[10**6], bits=[8, 11, 14])
    assert [p.name for p in measured] == [f"input/{len(faces)}/{bits}" for bits in (8, 11, 14)]
    assert measured[0].bytes < measured[1].bytes < measured[2].bytes
    assert measured[0].rms > 4 * measured[1].rms > 16 * measured[2].rms
    # Uniform rounding to a grid of 2^-8 moves a vertex by at most half a step along each axis.
    assert measured[0].rms < 3**0.5 / 2 / 255


def test_the_sweep_leaves_out_what_is_known_and_decimates_with_each_method() -> None:
    points, faces = torus(32, 16)
    reference = baseline.Reference.of(points, faces, 500)
    known = [f"{name}/100/8" for name in ("ndf", "qslim")]
    measured = [p for group in baseline.sweep(reference, known, [100], [8, 10]) for p in group]
    assert {p.name for p in measured} == {"ndf/100/10", "qslim/100/10", "ndf-even/100/8", "ndf-even/100/10"}
    assert all(0 < p.rms < 0.1 and p.bytes > 100 for p in measured)


def test_ratios_compare_at_equal_bytes_and_at_equal_error() -> None:
    asset = {"bytes": 200, "bytes_with_inverse": 260, "forward": 0.2, "backward": 0.25}
    entry = {"qem_draco": {"a": [100, 1.0, 0.5], "b": [400, 0.25, 0.25]}, "ndf": {"500/8": asset}}
    (row,) = benchmark.compare("shape", entry)
    assert row["rms"] == 0.25
    assert row["qem_draco_rms_at_these_bytes"] == pytest.approx(0.5) and row["error_ratio"] == pytest.approx(0.5)
    assert row["qem_draco_bytes_at_this_rms"] == 400 and row["bytes_ratio"] == pytest.approx(0.5)
    assert "500/8" in benchmark.table([row])


def test_the_json_is_the_same_data_with_a_line_for_each_measurement() -> None:
    results = {
        "shapes": {"s": {"faces": 3, "qem_draco": {"a": [1, 2.5, 3], "b": [4, 5, 6]}, "ndf": {}}},
        "summary": [],
    }
    text = benchmark.encoded(results)
    assert json.loads(text) == results
    assert any(line.strip() == '"a": [1, 2.5, 3],' for line in text.splitlines())


def test_a_run_fits_draws_and_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mesh").mkdir()
    write_mesh(tmp_path / "mesh" / "ring.ply", *torus(32, 16))
    output = tmp_path / "out.json"
    given = ["--data", str(tmp_path), "--shapes", "ring.ply", "--samples", "500", "--output", str(output)]
    fits = [*given, "--sizes", "100/2/8", "--set", "steps=2", "threads=1"]
    monkeypatch.setattr(benchmark, "sweep", partial(baseline.sweep, face_counts=(100, 200), bits=(8, 10)))
    assert benchmark.main(fits) == 0
    first = json.loads(output.read_text())
    entry = first["shapes"]["ring"]
    assert entry["ndf"]["100/2/8"]["config"]["hidden_width"] == 8 and entry["ndf"]["100/2/8"]["base_faces"] <= 100
    assert entry["ndf"]["100/2/8"]["bytes"] < entry["ndf"]["100/2/8"]["bytes_with_inverse"]
    assert first["summary"][0]["asset"] == "100/2/8" and output.with_suffix(".png").stat().st_size > 1000

    monkeypatch.setattr(benchmark, "fitted", lambda *_: pytest.fail("the fit is known"))
    assert benchmark.main(fits) == 0
    assert json.loads(output.read_text()) == first
    assert benchmark.main([*given, "--only", "summary"]) == 0

    called: list[int] = []
    monkeypatch.setattr(benchmark, "fitted", lambda _, config: called.append(config.steps) or entry["ndf"]["100/2/8"])
    assert benchmark.main([*fits[:-2], "steps=3", "threads=1"]) == 0
    assert called == [3]
    capsys.readouterr()
    assert benchmark.main([*given, "--only", "ndf", "--sizes", "100"]) == 2
    assert "FACES/DIMENSION" in capsys.readouterr().err


def test_a_size_out_of_bounds_is_refused(tmp_path: Path) -> None:
    write_mesh(tmp_path / "ring.ply", *torus(32, 16))
    shape = benchmark.Shape.read(tmp_path / "ring.ply", 100)
    with pytest.raises(ConfigError, match="size 2/8: faces"):
        benchmark.fit_config(shape, "2/8", {})
