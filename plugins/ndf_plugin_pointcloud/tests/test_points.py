"""Points without normals: solids, shells, and estimated normals."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from clouds import closest, cloud, near, off_surface, ring
from ndf_plugin_pointcloud.ellipse import within_ellipse
from ndf_plugin_pointcloud.local_planes import LocalDiscs
from ndf_plugin_pointcloud.local_quadrics import LocalQuadrics
from ndf_plugin_pointcloud.neighbours import noise_and_neighbours, quadric_neighbours
from ndf_plugin_pointcloud.orientation import oriented_normals
from ndf_plugin_pointcloud.points import PointsConfig
from ndf_plugin_pointcloud.points_surface import open_points
from scipy.spatial import KDTree

from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.interfaces import Surface
from ndf_core.mesh import face_normals
from ndf_core.surfaces.dilation import sampling_spacing


@pytest.fixture(scope="module")
def shape() -> trimesh.Trimesh:
    return ring()


@pytest.fixture(scope="module")
def surface(shape: trimesh.Trimesh) -> Surface:
    return open_points(cloud(shape, 6000)[0], PointsConfig())


def test_a_cloud_that_closes_becomes_a_solid(surface: Surface, shape: trimesh.Trimesh) -> None:
    assert "filled" in surface.notes[-1]
    mesh = surface.base_mesh.extract(500)
    check_base_mesh(mesh, euler_characteristic=0, components=1)
    found = surface.projector.project(torch.from_numpy(mesh.vertices))
    assert bool(found.converged.all())
    assert off_surface(shape, found.points.numpy()).mean() < 2e-3


def test_planes_are_closer_than_the_nearest_point(surface: Surface, shape: trimesh.Trimesh) -> None:
    queries = near(shape, 1500, 0.01)
    found = surface.projector.project(torch.from_numpy(queries))
    distance = off_surface(shape, found.points.numpy())
    nearby = closest(shape, queries)[0]
    points = cloud(shape, 6000)[0]
    nearest = points[KDTree(points).query(queries)[1]]
    ours, paper = (np.linalg.norm(x - nearby, axis=1).mean() for x in (found.points.numpy(), nearest))
    assert distance.mean() < 1e-3
    assert ours < 0.25 * paper
    assert found.normals is not None
    outwards = shape.face_normals[closest(shape, found.points.numpy())[2]]
    assert (np.einsum("nc,nc->n", found.normals.numpy(), outwards) > 0.8).mean() > 0.99


def test_projection_is_pure(surface: Surface, shape: trimesh.Trimesh) -> None:
    queries = torch.from_numpy(near(shape, 500, 0.01))
    found = surface.projector.project(queries)
    assert torch.equal(surface.projector.project(queries.flip(0)).points.flip(0), found.points)
    assert torch.equal(surface.projector.project(queries[3:4]).points, found.points[3:4])
    twice = surface.projector.project(found.points)
    assert float((twice.points - found.points).norm(dim=1).mean()) < 3e-4 * shape.extents.max()


def test_queries_over_gaps_do_not_converge(surface: Surface) -> None:
    middle = torch.tensor([[3.0, -2.0, 1.0]], dtype=torch.float64)  # of the ring's hole
    assert not bool(surface.projector.project(middle).converged[0])


@pytest.fixture(scope="module")
def bowl() -> np.ndarray:
    """The lower half of a sphere."""
    points = cloud(trimesh.creation.icosphere(subdivisions=4), 8000)[0]
    return points[points[:, 2] < 0]


def test_an_open_sheet_becomes_a_shell(bowl: np.ndarray) -> None:
    surface = open_points(bowl, PointsConfig())
    assert any("close around nothing" in note for note in surface.notes)
    assert "--open cap" in surface.notes[-1]
    mesh = surface.base_mesh.extract(600)
    check_base_mesh(mesh, euler_characteristic=2, components=1)
    found = surface.projector.project(torch.from_numpy(mesh.vertices))
    radius = found.points.norm(dim=1).numpy()
    assert (radius > 1.01).any() and (radius < 0.99).any()  # two sides
    assert surface.sample is not None
    samples = surface.sample(2000, np.random.default_rng(0))[0]
    height = np.linalg.norm(samples, axis=1)[samples[:, 2] < -0.2] - 1
    assert 0.4 < (height > 0).mean() < 0.65  # both sides, at half the spacing
    assert np.abs(np.abs(height).mean() / float(np.median(sampling_spacing(bowl))) - 0.5) < 0.05
    assert np.abs(height).std() < 0.1 * np.abs(height).mean()


def test_a_plate_thinner_than_its_points_are_apart_is_a_plate() -> None:
    """Its points have no sides to tell, and lie about one sheet."""
    plate = trimesh.creation.box((1, 1, 0.012))
    surface = open_points(cloud(plate, 6000)[0], PointsConfig())
    assert surface.sample is not None
    assert off_surface(plate, surface.sample(2000, np.random.default_rng(0))[0]).mean() < 3e-3


def test_a_solid_too_thin_to_be_dilated_is_a_solid() -> None:
    """Its points close around nothing before their balls fill it."""
    plate = trimesh.creation.box((1, 1, 0.06))
    points = cloud(plate, 6000)[0]
    surface = open_points(points, PointsConfig())
    assert "close around nothing" in surface.notes[0] and "one half" in surface.notes[-1]
    mesh = surface.base_mesh.extract(600)
    check_base_mesh(mesh, euler_characteristic=2, components=1)
    assert off_surface(plate, mesh.vertices).mean() < 5e-3
    assert "shell" in open_points(points, PointsConfig(open="shell")).notes[-1]


def test_or_a_capped_solid(bowl: np.ndarray) -> None:
    surface = open_points(bowl, PointsConfig(open="cap"))
    mesh = surface.base_mesh.extract(600)
    check_base_mesh(mesh, euler_characteristic=2, components=1)
    volume = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume
    assert volume > 0.6 * 2 / 3 * np.pi


def test_a_wall_keeps_its_inside(shape: trimesh.Trimesh) -> None:
    surface = open_points(cloud(shape, 6000)[0], PointsConfig(interior="keep"))
    check_base_mesh(surface.base_mesh.extract(1000), components=2, euler_characteristic=0)


def test_estimated_normals_agree_with_the_shape(shape: trimesh.Trimesh) -> None:
    points, normals = cloud(shape, 6000)
    for outwards in (None, normals):
        found = oriented_normals(points, 12, outwards)
        assert (np.einsum("nc,nc->n", found, normals) > 0.8).mean() > 0.99


def test_orient_hands_over(shape: trimesh.Trimesh) -> None:
    surface = open_points(cloud(shape, 6000)[0], PointsConfig(orient=True))
    assert surface.representation == "points"
    found = surface.projector.project(torch.from_numpy(near(shape, 1000, 0.01)))
    assert off_surface(shape, found.points[found.converged].numpy()).mean() < 6e-4


def cage() -> np.ndarray:
    """Points along circles of latitude and longitude of the unit sphere: curves, nowhere a patch of surface."""
    turn = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    tilts = [[circle[:, 0], circle[:, 1] * np.cos(a), circle[:, 1] * np.sin(a)] for a in np.pi * np.arange(3) / 3]
    heights = [[0.8 * circle[:, 0], 0.8 * circle[:, 1], 0 * turn + z] for z in (-0.6, 0.6)]
    return np.unique(np.round(np.concatenate([np.stack(c, axis=1) for c in tilts + heights]), 6), axis=0)


@pytest.mark.parametrize("kind", ["curves", "a sheet"])
def test_a_shell_is_where_the_dilation_is(kind: str, bowl: np.ndarray) -> None:
    points = cage() if kind == "curves" else bowl
    surface = open_points(points, PointsConfig(radius=0.15, thickness=None if kind == "curves" else 0.3))
    assert "shell" in surface.notes[-1]
    mesh = surface.base_mesh.extract(4000)
    found = surface.projector.project(torch.from_numpy(mesh.vertices))
    assert bool(found.converged.all())
    there = found.points.numpy()
    # A plane that went on beyond its points would take rims and the sides of curves along.
    assert np.quantile(np.linalg.norm(there - mesh.vertices, axis=1), 0.99) < 0.3 * 0.15
    distance = KDTree(points).query(there)[0]
    assert np.quantile(np.abs(distance - 0.15), 0.99) < 0.3 * 0.15
    before, after = (face_normals(vertices, mesh.faces.astype(np.int64)) for vertices in (mesh.vertices, there))
    folded = np.einsum("nc,nc->n", before, after) < 0
    assert np.linalg.norm(before[folded], axis=1).sum() < 2e-3 * np.linalg.norm(before, axis=1).sum()


def test_sides_of_a_thin_plate_stay_apart() -> None:
    """Closer together than the points of one side are."""
    across = np.stack(np.meshgrid(*[np.linspace(-1, 1, 30)] * 2), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.column_stack([across, np.full(len(across), z)]) for z in (-0.03, 0.03)])
    outwards = np.sign(points) * [0, 0, 1]
    above = np.random.default_rng(0).uniform(-0.8, 0.8, (500, 3)) * [1, 1, 0] + [0, 0, 0.05]
    for queries, side in ((above, 1), (above * [1, 1, -1], -1)):
        found = LocalQuadrics(points, 16, outwards)(queries, 1)
        np.testing.assert_allclose(found.points[:, 2], side * 0.03, atol=1e-5)
        np.testing.assert_allclose(found.normals[:, 2], side, atol=1e-5)


def test_closest_points_of_ellipses() -> None:
    rng = np.random.default_rng(0)
    places, half = rng.normal(size=(200, 2)) * 3, np.exp(rng.uniform(-4, 1, (200, 2)))
    found = within_ellipse(places, half)
    inside = (places**2 / half**2).sum(axis=1) <= 1
    assert inside.any() and np.array_equal(found[inside], places[inside])
    turn = np.linspace(0, 2 * np.pi, 20_001)
    ring = half[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    closest = np.linalg.norm(ring - places[:, None], axis=2).min(axis=1)
    np.testing.assert_allclose(np.linalg.norm(found - places, axis=1)[~inside], closest[~inside], rtol=1e-5)
    flat = within_ellipse(np.array([[1.0, 2.0], [0.5, 0.5]]), np.array([[0.0, 0.0], [0.0, 1.0]]))
    np.testing.assert_allclose(flat, [[0, 0], [0, 0.5]], atol=1e-6)


WALL = {"interior": "keep", "radius": 0.2}


@pytest.mark.parametrize(
    ("count", "options", "weight"),
    [(30_000, WALL, 1e3), (5_000, WALL, 1e4), (20_000, {}, 1e3), (4_000, {}, 1e4), (2_000, {}, 1e5)],
)
def test_the_map_follows_dense_points_and_keeps_to_its_base_mesh_on_sparse_ones(
    shape: trimesh.Trimesh, count: int, options: dict[str, object], weight: float
) -> None:
    surface = open_points(cloud(shape, count)[0], PointsConfig.model_validate(options))
    assert surface.training_defaults["loss"] == {"cycle": weight, "projection": 1e4}


def test_quadrics_through_a_plane_are_exact() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-1, 1, (2000, 2)), np.zeros((2000, 1))], axis=1)
    queries = rng.uniform(-0.5, 0.5, (100, 3)) * [1, 1, 0.1]
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    found = LocalQuadrics(points, 16, up)(queries, 1)
    np.testing.assert_allclose(found.points[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(found.points[:, :2], queries[:, :2], atol=1e-12)
    np.testing.assert_allclose(np.abs(found.normals[:, 2]), 1, atol=1e-12)


def test_quadrics_follow_what_is_curved() -> None:
    """Where a plane through the same points would lie below a sphere by half their reach squared."""
    points = cloud(trimesh.creation.icosphere(subdivisions=5), 2000)[0]
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = LocalQuadrics(points, 16, points)(1.01 * directions, 1)
    flat = LocalDiscs(points, 16)(1.01 * directions, 1)
    off, off_flat = (np.abs(np.linalg.norm(x.points, axis=1) - 1).mean() for x in (found, flat))
    assert off < 0.05 * off_flat
    np.testing.assert_allclose(np.einsum("nc,nc->n", found.normals, directions), 1, atol=2e-3)


def test_the_noise_is_found_and_sets_the_neighbours(shape: trimesh.Trimesh) -> None:
    points = cloud(shape, 20_000)[0]
    size = float(np.ptp(points, axis=0).max())
    counts: list[int] = []
    for noise in (0.0, 0.002, 0.005):
        noisy = points + np.random.default_rng(1).normal(size=points.shape) * noise * size
        found, wanted = noise_and_neighbours(noisy)
        assert abs(found / size - noise) < 5e-4
        counts.append(quadric_neighbours(wanted))
    assert counts[0] == 16
    assert 24 <= counts[1] < counts[2] <= 150


def test_noise_averages_out(shape: trimesh.Trimesh) -> None:
    points = cloud(shape, 20_000)[0]
    size = float(np.ptp(points, axis=0).max())
    points += np.random.default_rng(1).normal(size=points.shape) * 0.005 * size
    queries = torch.from_numpy(near(shape, 1500, 0.01))
    errors = [
        off_surface(
            shape, open_points(points, PointsConfig(neighbours=count)).projector.project(queries).points.numpy()
        )
        for count in (None, 16)
    ]
    assert errors[0].mean() < 2e-3 * size
    assert errors[0].mean() < 0.6 * errors[1].mean()
