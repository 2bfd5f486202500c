"""Oriented points: the level set of their winding number, and projection onto it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from clouds import closest, cloud, near, off_surface, ring
from ndf_plugin_pointcloud.areas import cell_areas, disc_areas
from ndf_plugin_pointcloud.denoising import OrientedPoints, without_noise
from ndf_plugin_pointcloud.level_set_mesh import WindingExtractor
from ndf_plugin_pointcloud.noise import noise_level, smoothing_for
from ndf_plugin_pointcloud.oriented_points import OrientedPointsConfig
from ndf_plugin_pointcloud.oriented_surface import open_oriented_points
from ndf_plugin_pointcloud.spatial_order import spatial_order
from ndf_plugin_pointcloud.tracing_projector import TracingProjector
from scipy.spatial import KDTree

from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.kernels.winding import WindingTree
from ndf_core.mesh import topology

CONFIG = OrientedPointsConfig(resolution=64)


@pytest.fixture(scope="module")
def shape() -> trimesh.Trimesh:
    return ring()


@pytest.fixture(scope="module")
def surface(shape: trimesh.Trimesh) -> Surface:
    return open_oriented_points(cloud(shape, 8000), CONFIG)


def test_the_base_mesh_has_the_topology_of_the_shape(surface: Surface, shape: trimesh.Trimesh) -> None:
    mesh = surface.base_mesh.extract(500)
    check_base_mesh(mesh, euler_characteristic=0, components=1)
    assert off_surface(shape, mesh.vertices).max() < 0.02


def test_projections_land_on_the_shape(surface: Surface, shape: trimesh.Trimesh) -> None:
    queries = near(shape, 2000, 0.01)
    found = surface.projector.project(torch.from_numpy(queries))
    assert found.converged.double().mean() > 0.999
    distance = off_surface(shape, found.points.numpy())
    assert distance.mean() < 3e-4
    assert np.quantile(distance, 0.99) < 1.5e-3
    assert found.normals is not None
    face = closest(shape, found.points.numpy())[2]
    assert np.einsum("nc,nc->n", found.normals.numpy(), shape.face_normals[face]).min() > 0.9


def test_over_a_hole_projections_land_on_the_cap() -> None:
    """The nearest samples are on the hole's rim, whose normals point along the cap: rays along them miss it."""
    can = trimesh.creation.cylinder(0.4, 2.0, sections=96)
    points, normals = cloud(can, 12_000)
    kept = normals[:, 2] < 0.5  # no lid
    surface = open_oriented_points((points[kept], normals[kept]), CONFIG)
    vertices, faces = as_extractor(surface).dense[:2]
    level_set = trimesh.Trimesh(vertices, faces, process=False)
    lid = vertices[faces].mean(axis=1)[:, 2] > 0.9
    queries = near(level_set.submesh([lid], append=True), 1000, 0.005)
    found = surface.projector.project(torch.from_numpy(queries))
    assert found.converged.double().mean() > 0.99
    way = np.linalg.norm(found.points.numpy() - queries, axis=1)
    beyond = way - closest(level_set, queries)[1]
    assert np.quantile(beyond[found.converged.numpy()], 0.99) < 0.03


def as_extractor(surface: Surface) -> WindingExtractor:
    assert isinstance(surface.base_mesh, WindingExtractor)
    return surface.base_mesh


def test_noise_and_turned_normals_are_averaged(shape: trimesh.Trimesh) -> None:
    points, normals = rough(*cloud(shape, 8000), 0.005 * shape.extents.max())
    queries = torch.from_numpy(near(shape, 2000, 0.01))
    errors: list[float] = []
    for denoise in (True, False):
        noisy = open_oriented_points((points, normals), CONFIG.model_copy(update={"denoise": denoise}))
        found = noisy.projector.project(queries)
        errors.append(float(off_surface(shape, found.points[found.converged].numpy()).mean()))
    assert errors[1] < 2.5e-3
    assert errors[0] < 0.8 * errors[1]


def rough(points: np.ndarray, normals: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Points moved by normal noise, and normals turned by 10 degrees in any direction."""
    rng = np.random.default_rng(0)
    axis = np.cross(normals, rng.standard_normal(normals.shape))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    normals = np.cos(np.radians(10)) * normals + np.sin(np.radians(10)) * axis
    return points + noise * rng.standard_normal(points.shape), normals


def test_a_plate_keeps_its_two_sides_under_noise_as_wide_as_it_is_thick() -> None:
    plate = trimesh.creation.box((1, 1, 0.02))
    tree, normals, _ = without_noise(oriented(*rough(*cloud(plate, 8000), 0.01)), cell_areas)
    above, inner = normals[:, 2] > 0, (np.abs(tree.data[:, :2]) < 0.45).all(axis=1)
    assert abs(tree.data[above & inner, 2].mean() - 0.01) < 5e-4
    assert abs(tree.data[~above & inner, 2].mean() + 0.01) < 5e-4
    assert tree.data[inner, 2].std() == pytest.approx(0.01, rel=0.1)
    surface = open_oriented_points(rough(*cloud(plate, 8000), 0.01), OrientedPointsConfig(resolution=128))
    vertices, faces = as_extractor(surface).dense[:2]
    assert topology(faces, len(vertices)).components == 1
    assert np.abs(np.abs(vertices[(np.abs(vertices[:, :2]) < 0.45).all(axis=1), 2]) - 0.01).mean() < 2e-3
    assert "neighbours scatter" in surface.notes[-1]


def test_points_without_noise_stay_where_they_are(shape: trimesh.Trimesh) -> None:
    clean = oriented(*cloud(shape, 3000))
    assert without_noise(clean, cell_areas) is clean
    lone = np.concatenate([np.asarray(clean.tree.data), [[50.0, 0, 0]]])
    kept = without_noise(oriented(*rough(lone, np.concatenate([clean.normals, [[0.0, 0, 1]]]), 0.05)), cell_areas)
    assert np.isfinite(kept.tree.data).all() and np.isfinite(kept.normals).all()


def oriented(points: np.ndarray, normals: np.ndarray) -> OrientedPoints:
    tree = KDTree(points)
    return OrientedPoints(tree, normals, cell_areas(tree, normals))


def test_areas_are_those_of_cells() -> None:
    """Points along lines stand for the strips between these, and points beside a hole for no half plane."""
    along, across = np.linspace(0, 1, 101), np.linspace(0, 1, 26)
    points = np.stack(np.meshgrid(along, across, [0.0], indexing="ij"), axis=3).reshape(-1, 3)
    areas = cell_areas(KDTree(points), np.tile([0.0, 0, 1], (len(points), 1)))
    inner = (np.abs(points[:, :2] - 0.5) < 0.4).all(axis=1)
    np.testing.assert_allclose(areas[inner], 0.01 * 0.04, rtol=0.05)
    assert areas.max() < 4 * 0.01 * 0.04


def test_projection_is_pure_and_idempotent(surface: Surface, shape: trimesh.Trimesh) -> None:
    queries = torch.from_numpy(near(shape, 1500, 0.02))
    kept = queries.clone()
    found = surface.projector.project(queries)
    assert torch.equal(queries, kept)
    again = surface.projector.project(queries.flip(0))
    assert torch.equal(again.points.flip(0), found.points)
    assert torch.equal(surface.projector.project(queries[10:20]).points, found.points[10:20])
    twice = surface.projector.project(found.points[found.converged])
    moved = (twice.points - found.points[found.converged]).norm(dim=1)[twice.converged] / shape.extents.max()
    assert float(moved.quantile(0.99)) < 1e-4
    single = surface.projector.project(queries.float())
    assert single.points.dtype == torch.float32


def test_the_winding_number_crosses_a_half_where_rays_end(surface: Surface, shape: trimesh.Trimesh) -> None:
    projector = surface.projector
    assert isinstance(projector, TracingProjector)
    queries = near(shape, 2000, 0.01)
    found, _, converged = projector.land(queries)
    way = found - queries
    step = 1e-4 * shape.extents.max() * way / np.linalg.norm(way, axis=1, keepdims=True)
    tree: WindingTree = projector._tree
    changed = (tree.values(found - step) > 0.5) != (tree.values(found + step) > 0.5)
    assert changed[converged].mean() > 0.999


def test_normals_that_point_inwards_are_turned_over(shape: trimesh.Trimesh) -> None:
    points, normals = cloud(shape, 3000)
    surface = open_oriented_points((points, -normals), CONFIG)
    assert "inwards" in surface.notes[0]
    mesh = surface.base_mesh.extract(300)
    check_base_mesh(mesh, euler_characteristic=0)


def test_duplicates_count_once(shape: trimesh.Trimesh) -> None:
    points, normals = cloud(shape, 3000)
    twice = np.concatenate([points, points[:1000]]), np.concatenate([normals, normals[:1000]])
    surface = open_oriented_points(twice, CONFIG)
    assert surface.notes == ("1,000 points at the place of others merged with them",)
    queries = torch.from_numpy(near(shape, 300, 0.01))
    once = open_oriented_points((points, normals), CONFIG).projector.project(queries)
    torch.testing.assert_close(surface.projector.project(queries).points, once.points)


def test_samples_lie_on_the_level_set(surface: Surface, shape: trimesh.Trimesh) -> None:
    assert surface.sample is not None
    points, normals = surface.sample(2000, np.random.default_rng(0))
    assert points.shape == (2000, 3) and normals is not None and normals.shape == (2000, 3)
    assert off_surface(shape, points).mean() < 3e-4
    # Even by area: a torus has more of it outside of its core circle than inside.
    outside = np.hypot(points[:, 0] - 3, points[:, 1] + 2) > 1
    assert abs(outside.mean() - (0.5 + 0.35 / np.pi)) < 0.04


def test_what_is_no_oriented_cloud_is_refused(shape: trimesh.Trimesh) -> None:
    points, normals = cloud(shape, 100)
    for source, message in (
        ((points, 0 * normals), "normals are zero"),
        ((points[:5], normals[:5]), "5 distinct finite points"),
        ((np.ones((50, 3)), np.ones((50, 3))), "1 distinct finite points"),
        ((np.outer(np.arange(50.0), [1, 2, 3]), np.ones((50, 3))), "on a line"),
        ((points, normals[:-1]), "need points"),
        (points, "pair of arrays"),
    ):
        with pytest.raises(InputError, match=message):
            open_oriented_points(source, CONFIG)


def test_a_query_that_is_not_finite_is_refused(surface: Surface) -> None:
    with pytest.raises(InputError, match="query point 1"):
        surface.projector.project(torch.tensor([[0.0, 0, 0], [torch.nan, 0, 0]]))


def test_smoothing_follows_the_noise(shape: trimesh.Trimesh) -> None:
    points, normals = cloud(shape, 8000)
    rng = np.random.default_rng(0)
    found: list[float] = []
    for noise in (0.0, 0.002, 0.01):
        moved = points + noise * shape.extents.max() * rng.standard_normal(points.shape)
        tree = KDTree(moved)
        radii = np.sqrt(cell_areas(tree, normals) / np.pi)
        found.append(smoothing_for(noise_level(tree, normals, radii)))
    assert found[0] == 1 and found[2] == 2
    assert 1 < found[1] < 2


def test_the_spatial_order_is_a_permutation_that_keeps_neighbours_together() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (4000, 3)) * [1, 0.2, 5] + [100, 0, 0]
    order = spatial_order(points)
    assert sorted(order.tolist()) == list(range(4000))
    steps = np.linalg.norm(np.diff(points[order], axis=0), axis=1)
    assert steps.mean() < 0.3 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()
    assert spatial_order(np.ones((5, 3))).tolist() == [0, 1, 2, 3, 4]
    assert len(spatial_order(np.zeros((0, 3)))) == 0


def test_the_two_sides_of_a_blade_are_no_noise() -> None:
    """Nor do they share an area, nor let the weights of the fit take them for noise."""
    points, normals = cloud(trimesh.creation.box((1, 1, 0.002)), 4000)
    tree = KDTree(points)
    areas = cell_areas(tree, normals)
    for found in (areas, disc_areas(tree, normals)):
        assert found.sum() == pytest.approx(2, rel=0.1)
    assert noise_level(tree, normals, np.sqrt(areas / np.pi)) < 0.02
    assert open_oriented_points((points, normals), CONFIG).training_defaults["loss"]["cycle"] == 1e3
    moved = points + 0.01 * np.random.default_rng(0).standard_normal(points.shape)
    assert open_oriented_points((moved, normals), CONFIG).training_defaults["loss"]["cycle"] == 1e4
