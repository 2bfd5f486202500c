"""`benchmarks/accuracy.py`: its figures against an independent computation, its gate, its folds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import igl
import numpy as np
import pytest
from benchmark_scripts import script
from numpy import ndarray as Array
from small_assets import icosphere, small_content, torus

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.errors import ConfigError
from ndf_core.fitting.measure import DenseMap, dense_map
from ndf_core.mesh import topology

accuracy = script("accuracy")
SAMPLES = 20_000


@pytest.fixture(scope="module")
def asset() -> Asset:
    """A bumpy torus, far from the coordinates' origin and not of size 3."""
    return Asset(small_content(torus(24, 12), amplitude=0.03, scale=0.7, center=(5.0, -2.0, 1.0)))


@pytest.fixture(scope="module")
def mesh(asset: Asset) -> tuple[Array, Array]:
    """The surface: a fine smooth torus where the asset's base mesh lies, input units."""
    points, faces = torus(96, 48)
    low, high = points.min(axis=0), points.max(axis=0)
    box = (points - (low + high) / 2) * (3 / (high - low).max())
    return asset.to_input(box), faces


@pytest.fixture(scope="module")
def figures(asset: Asset, mesh: tuple[Array, Array]) -> dict[str, Any]:
    return accuracy.measure_asset(asset, ndf_core.open(mesh, "mesh"), SAMPLES)


def weighted(asset: Asset, distance: Any, rng: np.random.Generator) -> tuple[Array, Array]:
    """Values at uniform base points and the area elements of the map there, by central differences."""
    faces = np.repeat(np.arange(len(asset.content.faces), dtype=np.int32), 60)
    inner = rng.dirichlet([1, 1, 1], len(faces)) * 0.98 + 0.02 / 3
    step = 2e-3
    moves = [step * np.array(v, dtype=float) for v in ((-1, 1, 0), (-1, 0, 1))]
    along = [asset.map_points(faces, inner + m) - asset.map_points(faces, inner - m) for m in moves]
    return distance(asset.map_points(faces, inner), faces, inner), np.linalg.norm(np.cross(*along), axis=1)


def test_field_to_surface_is_that_of_importance_sampling_and_libigl(
    asset: Asset, mesh: tuple[Array, Array], figures: dict[str, Any]
) -> None:
    def to_mesh(points: Array, *_: Array) -> Array:
        return np.sqrt(igl.point_mesh_squared_distance(points, mesh[0], mesh[1].astype(np.int64))[0])

    distance, weight = weighted(asset, to_mesh, np.random.default_rng(1))
    distance = distance / asset.longest_side
    order = np.argsort(distance)
    below = np.cumsum(weight[order]) / weight.sum()
    expected = {
        "mean": float(np.average(distance, weights=weight)),
        "rms": float(np.sqrt(np.average(distance**2, weights=weight))),
        "p99": float(distance[order][np.searchsorted(below, 0.99)]),
    }
    for name, value in expected.items():
        assert figures["field_to_surface"][name] == pytest.approx(value, rel=0.03), name
    assert figures["field_to_surface"]["p99"] < figures["field_to_surface"]["max"] <= distance.max() * 1.05


def test_surface_to_field_is_that_of_libigl_on_the_extracted_mesh(
    asset: Asset, mesh: tuple[Array, Array], figures: dict[str, Any]
) -> None:
    fine = asset.extract(asset.longest_side / 200)
    area = igl.doublearea(mesh[0], mesh[1].astype(np.int64))
    rng = np.random.default_rng(2)
    chosen = rng.choice(len(area), SAMPLES, p=area / area.sum())
    points = np.einsum("nc,ncx->nx", rng.dirichlet([1, 1, 1], SAMPLES), mesh[0][mesh[1][chosen]])
    squared = igl.point_mesh_squared_distance(points, fine.vertices, fine.faces.astype(np.int64))[0]
    distance = np.sqrt(squared) / asset.longest_side
    assert figures["surface_to_field"]["rms"] == pytest.approx(float(np.sqrt((distance**2).mean())), rel=0.03)
    assert figures["surface_to_field"]["mean"] == pytest.approx(float(distance.mean()), rel=0.03)
    assert figures["two_sided_rms"] == max(figures[side]["rms"] for side in accuracy.DIRECTIONS)


def test_cycle_loss_is_in_the_box_and_needs_an_inverse(asset: Asset, figures: dict[str, Any]) -> None:
    content = asset.content

    def cycle(points: Array, faces: Array, inner: Array) -> Array:
        back = asset.evaluator("inverse").at_points((points - content.center) / content.scale)
        return ((back - np.einsum("nc,ncx->nx", inner, content.vertices[content.faces[faces]])) ** 2).sum(axis=1)

    value, weight = weighted(asset, cycle, np.random.default_rng(3))
    assert figures["cycle_loss"] == pytest.approx(float(np.average(value, weights=weight)), rel=0.03)
    client = Asset(replace(content, fields={"displacement": content.fields["displacement"]}))
    surface = ndf_core.open(icosphere(2), "mesh")
    assert accuracy.measure_asset(client, surface, 100)["cycle_loss"] is None


@pytest.mark.parametrize("base", [icosphere(0), torus()])
def test_welding_gives_the_base_mesh_refined(base: tuple[Array, Array]) -> None:
    vertices, faces = base
    dense = dense_map(
        len(faces), lambda face, inner: np.einsum("nc,ncx->nx", inner, vertices[faces[face]]), 9 * len(faces)
    )
    index = accuracy.weld(dense, faces)
    counts, coarse = topology(index[dense.triangles], int(index.max()) + 1), topology(faces, len(vertices))
    assert counts.closed and counts.manifold
    assert counts.euler_characteristic == coarse.euler_characteristic
    # Vertices of the same name are at the same place, and only those.
    places = np.unique(np.round(dense.vertices, 9), axis=0)
    assert len(places) == counts.vertices


def test_opposed_area_sees_a_fold_across_an_edge_of_the_base_mesh() -> None:
    faces = np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32)
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    shut = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.1, 0.1, 0]])

    def dense(vertices: Array) -> DenseMap:
        return dense_map(2, lambda face, inner: np.einsum("nc,ncx->nx", inner, vertices[faces[face]]), 32)

    assert accuracy.opposed_area(dense(flat), faces) == 0.0
    # Each base face is cut into 4^2 triangles of equal area, 4 of which have an edge on the common one.
    assert accuracy.opposed_area(dense(shut), faces) == pytest.approx(4 / 16)


def test_requirements() -> None:
    result = {"field_to_surface": {"rms": 1e-4}, "surface_to_field": None, "converged": 0.5, "folded_area": 0.0}
    parse = accuracy.Requirement.parse
    assert parse("field_to_surface.rms=1e-4").failure(result) is None
    assert parse("folded_area=0").failure(result) is None
    assert parse("field_to_surface.rms<=9e-5").failure(result) == "field_to_surface.rms is 0.0001, required <= 9e-05"
    assert parse("converged>=0.5").failure(result) is None
    assert "required >= 0.9" in parse("converged>=0.9").failure(result)
    assert "is None" in parse("surface_to_field.rms=1").failure(result)
    assert "is nan" in parse("folded_area=1").failure({"folded_area": float("nan")})


@pytest.mark.parametrize("text", ["field_to_surface.rms", "rms=1", "cycle_loss=small", "folded_area=nan", "=1"])
def test_a_wrong_requirement_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--require"):
        accuracy.Requirement.parse(text)


def test_the_script_gates_and_writes_one_object(
    tmp_path: Path, asset: Asset, mesh: tuple[Array, Array], capsys: pytest.CaptureFixture[str]
) -> None:
    from ndf_core.meshio import write_mesh

    asset.save(tmp_path / "a.ndf")
    write_mesh(tmp_path / "m.ply", *mesh)
    given = [str(tmp_path / "a.ndf"), str(tmp_path / "m.ply"), "--samples", "500", "--json", str(tmp_path / "o.json")]
    assert accuracy.main([*given, "--require", "field_to_surface.max=1"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "o.json").read_text())
    assert printed["asset_bytes"] == (tmp_path / "a.ndf").stat().st_size and printed["fitted_to_it"] is False
    assert accuracy.main([*given, "--require", "field_to_surface.rms=0"]) == 1
    assert "not met: field_to_surface.rms" in capsys.readouterr().err
    assert accuracy.main([*given, "--require", "nothing=0"]) == 2
    assert accuracy.main([given[1], *given[1:]]) == 3
