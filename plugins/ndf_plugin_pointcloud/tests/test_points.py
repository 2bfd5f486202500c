"""Points without normals: solids, shells, and estimated normals."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from clouds import closest, cloud, near, off_surface, ring
from ndf_plugin_pointcloud.local_planes import LocalPlanes
from ndf_plugin_pointcloud.orientation import oriented_normals
from ndf_plugin_pointcloud.points import PointsConfig
from ndf_plugin_pointcloud.points_surface import open_points
from scipy.spatial import KDTree

from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.interfaces import Surface


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
    assert 0.4 < (height > 0).mean() < 0.65  # both sides, at the distance
    assert np.abs(height).std() < 0.05 * np.abs(height).mean()


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


def test_planes_through_a_plane_are_exact() -> None:
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(-1, 1, (2000, 2)), np.zeros((2000, 1))], axis=1)
    queries = rng.uniform(-0.5, 0.5, (100, 3)) * [1, 1, 0.1]
    found = LocalPlanes(points, 12)(queries, 1)
    np.testing.assert_allclose(found.points[:, 2], 0, atol=1e-12)
    np.testing.assert_allclose(found.points[:, :2], queries[:, :2], atol=1e-12)
    np.testing.assert_allclose(np.abs(found.normals[:, 2]), 1, atol=1e-12)
