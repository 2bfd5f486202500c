"""Laws of assets: golden files stay readable, evaluation equals the plain network, reading imports nothing heavy."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_assets import icosphere, open_grid, small_content, torus

from ndf_core.asset.asset import Asset
from ndf_core.asset.fields import field_arrays
from ndf_core.asset.file import write_asset
from ndf_core.asset.placement import Placement
from ndf_core.asset.pushforward import mapped_points
from ndf_core.errors import AssetError
from ndf_core.kernels.reference import field as reference

DATA = Path(__file__).resolve().parents[1] / "data"


@pytest.mark.parametrize("version", [1, 2])
def test_golden_assets(version: int) -> None:
    """Made once; if this fails, the reader is wrong, never the file. Expected values: the float64 reference."""
    asset = Asset.load(DATA / f"golden_v{version}.ndf")
    told = json.loads((DATA / f"golden_v{version}.json").read_text())
    expected = {name: np.array(values) for name, values in told.items()}
    at = expected["faces"].astype(np.int32), expected["barycentric"]
    for name in ("displacement", "heat"):
        np.testing.assert_allclose(asset.evaluate(*at, field=name), expected[name], rtol=0, atol=3e-6)
    inverse = asset.evaluator("inverse").at_points(expected["displacement"])
    np.testing.assert_allclose(inverse, expected["inverse"], rtol=0, atol=3e-6)
    assert asset.content.provenance["note"].startswith(f"golden asset of format version {version}")
    np.testing.assert_array_equal(asset.content.center, [10.0, -2.5, 0.1])
    assert asset.content.scale == 0.7
    assert (asset.info()["base_mesh"]["vertices"], asset.info()["base_mesh"]["genus"]) == (45, 1)


@pytest.mark.parametrize("quantised", [True, False])
def test_evaluation_is_the_network(quantised: bool) -> None:
    content = small_content(quantised=quantised)
    asset = Asset(content)
    rng = np.random.default_rng(0)
    faces = rng.integers(0, len(content.faces), size=300).astype(np.int32)
    weights = rng.dirichlet((1.0, 1.0, 1.0), size=300)
    arrays = field_arrays(content.fields["displacement"])
    expected = reference.evaluate_field(arrays, faces, weights, content.vertices, content.faces)
    np.testing.assert_allclose(asset.evaluate(faces, weights), expected, rtol=0, atol=3e-6)


def test_a_placed_base_mesh_is_where_the_map_starts_and_learned_fields_do_not_see_it() -> None:
    """The displacement, its derivative and the extracted mesh start from the placed vertices."""
    content = small_content(icosphere(2))
    block = replace(content.fields["displacement"], name="mark", kind="continuous", residual=False)
    content = replace(content, fields={**content.fields, "mark": block})
    placed = replace(content, placement=Placement.of(content.vertices * [1.0, 0.7, 0.5], content.faces))
    rng = np.random.default_rng(0)
    faces, weights = rng.integers(0, len(content.faces), 300).astype(np.int32), rng.dirichlet((1.0, 1.0, 1.0), 300)
    arrays = field_arrays(content.fields["displacement"])
    expected = reference.evaluate_field(arrays, faces, weights, placed.placed, content.faces)
    one, other = Asset(placed), Asset(content)
    np.testing.assert_allclose(one.evaluate(faces, weights), expected, rtol=0, atol=3e-6)
    np.testing.assert_array_equal(one.evaluate(faces, weights, "mark"), other.evaluate(faces, weights, "mark"))
    np.testing.assert_allclose(mapped_points(placed, faces, weights).points, expected, rtol=0, atol=3e-6)
    assert one.info()["base_mesh"]["placed"] and not other.info()["base_mesh"]["placed"]
    assert (one.info()["format_version"], other.info()["format_version"]) == (2, 1)
    sides = np.ptp(one.extract(0.1).vertices, axis=0)
    np.testing.assert_allclose(sides, 3 * np.array([1.0, 0.7, 0.5]), atol=0.3)


def test_map_points_is_in_input_units() -> None:
    center = (1e6, -3.0, 0.25)
    asset = Asset(small_content(center=center, scale=1e-3))
    faces, weights = np.arange(20, dtype=np.int32), np.full((20, 3), 1 / 3)
    box = asset.evaluate(faces, weights).astype(np.float64)
    np.testing.assert_array_equal(asset.map_points(faces, weights), box * 1e-3 + np.array(center))


def test_field_is_continuous_across_base_edges() -> None:
    """A point of an edge is the same point seen from both faces."""
    content = small_content(torus())
    asset = Asset(content)
    faces = content.faces
    for f in range(len(faces)):
        for i in range(3):
            a, b = faces[f, i], faces[f, (i + 1) % 3]
            other = np.flatnonzero((faces == a).any(1) & (faces == b).any(1))
            (g,) = other[other != f]
            weights = np.zeros((2, 3))
            weights[0, i], weights[0, (i + 1) % 3] = 0.3, 0.7
            weights[1, faces[g] == a], weights[1, faces[g] == b] = 0.3, 0.7
            one, two = asset.evaluate(np.array([f, g], np.int32), weights)
            np.testing.assert_allclose(one, two, rtol=0, atol=1e-6)


def test_a_zero_network_is_the_identity() -> None:
    content = small_content(amplitude=0.0)
    faces = np.arange(len(content.faces), dtype=np.int32)
    weights = np.full((len(faces), 3), 1 / 3)
    expected = content.vertices[content.faces].mean(axis=1)
    np.testing.assert_allclose(Asset(content).evaluate(faces, weights), expected, rtol=0, atol=2e-7)


@pytest.mark.parametrize(("mesh", "genus"), [(icosphere(), 0), (torus(), 1), (open_grid(), None)])
def test_info(mesh: object, genus: int | None, tmp_path: Path) -> None:
    content = small_content(mesh, scale=2.0)  # pyright: ignore[reportArgumentType]
    asset = Asset(content)
    info = json.loads(json.dumps(asset.info()))
    assert info["bytes"]["total"] == asset.size == asset.save(tmp_path / "a.ndf")
    assert info["base_mesh"]["genus"] == genus
    assert info["base_mesh"]["closed"] == (genus is not None)
    assert info["base_mesh"]["vertices"] == len(content.vertices)
    assert info["fields"]["inverse"]["domain"] == "space"
    assert info["longest_side"] == pytest.approx(6.0)
    assert info["default_edge_length"] == pytest.approx(0.04)
    assert info["provenance"] == content.provenance


def test_asking_for_what_is_not_there() -> None:
    asset = Asset(small_content())
    faces, weights = np.zeros(1, np.int32), np.full((1, 3), 1 / 3)
    with pytest.raises(AssetError, match="no field 'colour'; it has displacement, inverse"):
        asset.evaluate(faces, weights, field="colour")
    with pytest.raises(AssetError, match="over space"):
        asset.evaluate(faces, weights, field="inverse")
    with pytest.raises(AssetError, match="over the base mesh"):
        asset.evaluator().at_points(weights)
    with pytest.raises(AssetError, match="index 80 is outside"):
        asset.evaluate(faces + 80, weights)


LIGHT = """
import sys
from ndf_core.asset.asset import Asset
from ndf_core.meshio import write_mesh
asset = Asset.load(sys.argv[1])
mesh = asset.extract(asset.default_edge_length * 5)
write_mesh(sys.argv[2], mesh.vertices, mesh.faces)
asset.info()
heavy = ["jaxtyping", "torch", "scipy", "igl", "open3d", "trimesh", "rich", "pydantic", "skimage", "matplotlib"]
print([name for name in heavy if name in sys.modules], any(name.startswith("ndf_plugin") for name in sys.modules))
"""


def test_opening_and_extracting_imports_nothing_heavy(tmp_path: Path) -> None:
    write_asset(small_content(), tmp_path / "a.ndf")
    command = [sys.executable, "-c", LIGHT, str(tmp_path / "a.ndf"), str(tmp_path / "a.ply")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split("\n")[0] == "[] False"
