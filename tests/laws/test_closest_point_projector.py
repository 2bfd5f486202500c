"""Projection onto meshes against brute force, and its laws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from mesh_files import ball, cube, obj, together, torus
from ndf_plugin_sdf.mesh import MeshConfig
from ndf_plugin_sdf.mesh_surface import open_mesh

from ndf_core.errors import InputError
from ndf_core.mesh import face_normals
from ndf_core.surfaces.closest_point_projector import ClosestPointProjector

Mesh = tuple[np.ndarray, np.ndarray]


def points_near(mesh: Mesh, count: int, noise: float) -> torch.Tensor:
    rng = np.random.default_rng(0)
    vertices, faces = mesh
    weights = rng.dirichlet([1, 1, 1], count)
    on = (vertices[faces[rng.integers(0, len(faces), count)]] * weights[:, :, None]).sum(axis=1)
    return torch.from_numpy(on + noise * rng.normal(size=on.shape))


def brute_force(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Distance to the nearest of all triangles: to its plane if that is inside it, else to its edges."""
    a, b, c = (mesh[0][mesh[1][:, i]] for i in range(3))
    best = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        t = np.einsum("nfk,fk->nf", points[:, None] - p, edge) / (edge**2).sum(axis=1)
        foot = p + np.clip(t, 0, 1)[:, :, None] * edge
        best = np.minimum(best, np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.einsum("nfk,fk->nf", points[:, None] - a, normal)
    foot = points[:, None] - height[:, :, None] * normal
    inside = np.ones(height.shape, bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("nfk,fk->nf", np.cross(q - p, foot - p), normal) >= 0
    return np.minimum(best, np.where(inside, np.abs(height), np.inf).min(axis=1))


@pytest.mark.parametrize("mesh", [ball(), torus(), cube()], ids=["ball", "torus", "cube"])
def test_it_is_the_closest_point(mesh: Mesh) -> None:
    points = points_near(mesh, 300, 0.2)
    answer = ClosestPointProjector(*mesh).project(points)
    assert bool(answer.converged.all())
    distance = (answer.points - points).norm(dim=1).numpy()
    np.testing.assert_allclose(distance, brute_force(mesh, points.numpy()), atol=1e-12)
    np.testing.assert_allclose(brute_force(mesh, answer.points.numpy()), 0.0, atol=1e-12)


def test_normals_tell_inside_from_outside() -> None:
    """Angle-weighted pseudonormals: their sign is right even where the closest point is a vertex or an edge."""
    for mesh in (torus(), cube()):
        points = points_near(mesh, 2000, 0.3)
        answer = ClosestPointProjector(*mesh).project(points)
        assert answer.normals is not None
        np.testing.assert_allclose(answer.normals.norm(dim=1).numpy(), 1.0, rtol=1e-12)
        outside = ((points - answer.points) * answer.normals).sum(dim=1) > 0
        x = points.numpy()
        if mesh[0].shape == (8, 3):
            expected = (np.abs(x) > 1).any(axis=1)
            assert (outside.numpy() == expected).all()
        else:
            level = (np.hypot(x[:, 0], x[:, 1]) - 1) ** 2 + x[:, 2] ** 2
            clear = np.abs(np.sqrt(level) - 0.35) > 0.03
            assert (outside.numpy() == (level > 0.35**2))[clear].all()


def test_normals_on_faces_edges_and_vertices_of_a_cube() -> None:
    projector = ClosestPointProjector(*cube())
    points = torch.tensor([[0.3, 0.1, 2.0], [2.0, 0.2, 2.0], [2.0, 2.0, -2.0], [0.2, 0.2, 3.0]], dtype=torch.float64)
    normals = projector.project(points).normals
    assert normals is not None
    half, third = 0.5**0.5, 3**-0.5
    expected = [[0, 0, 1], [half, 0, half], [third, third, -third], [0, 0, 1]]
    np.testing.assert_allclose(normals.numpy(), expected, atol=1e-12)


def test_laws() -> None:
    mesh = torus()
    projector, points = ClosestPointProjector(*mesh), points_near(torus(), 500, 0.1)
    whole = projector.project(points)
    assert whole.normals is not None
    # points on the surface stay; twice is once
    again = projector.project(whole.points)
    assert float((again.points - whole.points).abs().max()) < 1e-14
    # rows are independent
    order = torch.from_numpy(np.random.default_rng(1).permutation(500))
    for part in order.split(77):
        alone = projector.project(points[part])
        assert alone.normals is not None
        assert torch.equal(alone.points, whole.points[part])
        assert torch.equal(alone.normals, whole.normals[part])
    # dtype kept, input left alone, nothing at all works
    single = points.float()
    before = single.clone()
    assert projector.project(single).points.dtype == torch.float32
    assert torch.equal(single, before)
    assert projector.project(points[:0]).points.shape == (0, 3)
    # threads do not change it
    torch.set_num_threads(2)
    many = points_near(mesh, 5000, 0.1)
    two = projector.project(many).points
    torch.set_num_threads(1)
    assert torch.equal(two, projector.project(many).points)


def test_queries_that_are_not_finite_are_refused() -> None:
    points = torch.zeros(3, 3)
    points[1, 0] = float("nan")
    with pytest.raises(InputError, match="query point 1: a coordinate is not finite"):
        ClosestPointProjector(*cube()).project(points)


@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)])
def test_units_and_offsets(scale: float, offset: float) -> None:
    vertices, faces = torus()
    points = points_near((vertices, faces), 300, 0.1)
    one = ClosestPointProjector(vertices, faces).project(points)
    other = ClosestPointProjector(vertices * scale + offset, faces).project(points * scale + offset)
    np.testing.assert_allclose((other.points - offset) / scale, one.points, atol=1e-12 if offset == 0 else 1e-9)


def test_samples_are_on_the_mesh_and_even_by_area() -> None:
    vertices, faces = cube()
    vertices = vertices * [1, 2, 3]
    surface = open_mesh((vertices, faces), MeshConfig())
    assert surface.sample is not None
    points, normals = surface.sample(40_000, np.random.default_rng(0))
    half = np.array([1.0, 2, 3])
    face = np.argmax(np.abs(points) / half, axis=1)
    np.testing.assert_allclose(np.take_along_axis(np.abs(points), face[:, None], 1)[:, 0], half[face], atol=1e-12)
    assert normals is not None
    np.testing.assert_allclose(np.take_along_axis(np.abs(normals), face[:, None], 1), 1.0, atol=1e-12)
    share = np.array([6.0, 3, 2]) / 11
    expected = share * 40_000
    assert ((np.bincount(face) - expected) ** 2 / expected).sum() < 25
    top = points[face == 2]
    counts = np.histogram2d(top[:, 0], top[:, 1], bins=4)[0]
    assert ((counts - counts.mean()) ** 2 / counts.mean()).sum() < 60
    outward = (points * normals).sum(axis=1) > 0
    assert outward.all()


def test_opening_files(tmp_path: Path) -> None:
    path = tmp_path / "two.obj"
    path.write_bytes(obj(*together(ball(), ball(2, 1.0, (50, 0, 0)))))
    surface = open_mesh(path, MeshConfig())
    assert surface.representation == "mesh"
    base = surface.base_mesh.extract(300)
    assert len(base.faces) <= 300
    middle = base.vertices[:, 0] > 25
    assert middle.any()
    assert not middle.all()
    elsewhere = tmp_path / "copy.obj"
    elsewhere.write_bytes(path.read_bytes().replace(b"# made", b"# copied"))
    assert open_mesh(elsewhere, MeshConfig()).fingerprint == surface.fingerprint
    assert open_mesh(path, MeshConfig(resolution=64)).fingerprint != surface.fingerprint
    assert face_normals(base.vertices, base.faces).shape == (len(base.faces), 3)


@pytest.mark.parametrize(
    "source",
    [7, (1,), ([[0, 0, 0]], [[0.5, 1, 2]]), ([[0, 0]], [[0, 0, 0]]), (np.zeros((3, 3)), np.zeros((0, 3), int))],
)
def test_objects_that_are_no_mesh(source: object) -> None:
    with pytest.raises(InputError):
        open_mesh(source, MeshConfig())
