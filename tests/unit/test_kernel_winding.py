"""Fast winding numbers against the sums that they approximate."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from ndf_core.kernels.reference.winding import winding_of_points, winding_of_triangles
from ndf_core.kernels.winding import WindingTree
from ndf_core.readers.mesh_file import read_mesh_file


def cloud(mesh: trimesh.Trimesh, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a surface, their area vectors, and the radii of their balls."""
    points, face = trimesh.sample.sample_surface(mesh, count, seed=seed)
    area = np.pi * KDTree(points).query(points, k=21)[0][:, 20] ** 2 / 20
    return np.asarray(points), area[:, None] * mesh.face_normals[face], 1.5 * np.sqrt(area / np.pi)


def near_and_far(mesh: trimesh.Trimesh, count: int) -> np.ndarray:
    """Half within 1% of the size of the surface, half in the box around it."""
    rng = np.random.default_rng(1)
    points, face = trimesh.sample.sample_surface(mesh, count // 2, seed=2)
    size = mesh.extents.max()
    near = points + mesh.face_normals[face] * rng.uniform(-0.01, 0.01, (count // 2, 1)) * size
    far = rng.uniform(mesh.bounds[0] - 0.1 * size, mesh.bounds[1] + 0.1 * size, (count - count // 2, 3))
    return np.concatenate([near, far])


@pytest.fixture(scope="module")
def knot() -> trimesh.Trimesh:
    """A bent tube, far from the origin, in odd units."""
    t = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    path = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    tangent = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, [0.3, 0.2, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(tangent, across)
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)[None, :, None]
    rings = path[:, None] + 0.4 * (np.cos(turn) * across[:, None] + np.sin(turn) * third[:, None])
    i, j = np.meshgrid(np.arange(120), np.arange(16), indexing="ij")
    a, b = 16 * i + j, 16 * ((i + 1) % 120) + j
    c, d = 16 * i + (j + 1) % 16, 16 * ((i + 1) % 120) + (j + 1) % 16
    faces = np.concatenate([np.stack(x, axis=-1).reshape(-1, 3) for x in ((a, b, d), (a, d, c))])
    mesh = trimesh.Trimesh(25.0 * rings.reshape(-1, 3) + np.array([1000, -300, 50]), faces, process=False)
    assert mesh.is_watertight
    return mesh if mesh.volume > 0 else trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def test_closed_triangles_give_one_inside_and_nothing_outside(knot: trimesh.Trimesh) -> None:
    queries = near_and_far(knot, 800)
    values = WindingTree.of_triangles(knot.vertices, knot.faces).values(queries)
    exact = winding_of_triangles(queries, knot.triangles)
    assert np.abs(values - exact).mean() < 1e-3
    assert np.abs(values - exact).max() < 1e-2
    assert np.abs(exact - np.round(exact)).max() < 1e-6
    assert ((values > 0.5) == (exact > 0.5)).all()


def test_points_approximate_the_sum_of_spread_dipoles(knot: trimesh.Trimesh) -> None:
    queries, sources = near_and_far(knot, 1000), cloud(knot, 6000)
    error = WindingTree.of_points(*sources).values(queries) - winding_of_points(queries, *sources)
    assert np.abs(error).mean() < 1e-3
    assert np.quantile(np.abs(error), 0.99) < 1e-2


def test_a_larger_beta_is_more_exact(knot: trimesh.Trimesh) -> None:
    queries, sources = near_and_far(knot, 500), cloud(knot, 3000)
    exact = winding_of_points(queries, *sources)
    errors = [
        np.abs(WindingTree.of_points(*sources, beta).values(queries) - exact).mean() for beta in (1.5, 2.5, 4, 50)
    ]
    assert errors[0] > 4 * errors[1] > 4 * errors[2]
    assert errors[3] < 1e-5  # everything source by source: float32 alone


@pytest.mark.parametrize("kind", ["triangles", "points"])
def test_gradients_are_derivatives_of_the_exact_sum(knot: trimesh.Trimesh, kind: str) -> None:
    queries = near_and_far(knot, 200)
    if kind == "triangles":
        tree = WindingTree.of_triangles(knot.vertices, knot.faces[:-300], beta=3)  # with a hole: else it is zero
        exact = lambda q: winding_of_triangles(q, knot.triangles[:-300])  # noqa: E731
    else:
        sources = cloud(knot, 3000)
        tree = WindingTree.of_points(*sources, beta=3)
        exact = lambda q: winding_of_points(q, *sources)  # noqa: E731
    values, gradients = tree.values_and_gradients(queries)
    np.testing.assert_array_equal(values, tree.values(queries))
    step = 1e-3
    differences = np.stack(
        [(exact(queries + step * axis) - exact(queries - step * axis)) / (2 * step) for axis in np.eye(3)], axis=1
    )
    error = np.linalg.norm(gradients - differences, axis=1)
    assert np.median(error) < 0.02 / knot.extents.max()
    assert np.quantile(error, 0.98) < 0.02 * np.quantile(np.linalg.norm(differences, axis=1), 0.98)


def test_rows_do_not_depend_on_each_other_or_on_threads(knot: trimesh.Trimesh) -> None:
    queries = near_and_far(knot, 5000)
    tree = WindingTree.of_triangles(knot.vertices, knot.faces)
    values = tree.values(queries, threads=2)
    order = np.random.default_rng(0).permutation(len(queries))
    np.testing.assert_array_equal(tree.values(queries[order]), values[order])
    np.testing.assert_array_equal(tree.values(queries[7:8]), values[7:8])


def test_w_does_not_change_with_frame_and_units(knot: trimesh.Trimesh) -> None:
    queries, (points, areas, radii) = near_and_far(knot, 500), cloud(knot, 3000)
    move = np.array([1e5, 2e5, -4e5])
    moved = WindingTree.of_points(1e-6 * points + move, 1e-12 * areas, 1e-6 * radii)
    expected = WindingTree.of_points(points, areas, radii).values(queries)
    # 1e5 in float64 leaves four digits of the size 1e-4.
    assert np.median(np.abs(moved.values(1e-6 * queries + move) - expected)) < 1e-3


def test_rays_end_at_a_sign_change(knot: trimesh.Trimesh) -> None:
    sources = cloud(knot, 6000)
    tree, size = WindingTree.of_points(*sources), float(knot.extents.max())
    points, face = trimesh.sample.sample_surface(knot, 3000, seed=5)
    normals, heights = knot.face_normals[face], np.random.default_rng(0).uniform(-0.01, 0.01, 3000) * size
    origins = points + heights[:, None] * normals
    full = np.full(len(origins), 1.0)
    found = tree.trace(origins, normals, heights, 1e-3 * size * full, 0.1 * size * full, 1e-4 * size, threads=2)
    assert np.isfinite(found).mean() > 0.999
    good = np.isfinite(found)
    side = [
        tree.values(origins[good] + (found[good] + offset)[:, None] * normals[good]) > 0.5
        for offset in (-1e-4 * size, 1e-4 * size)
    ]
    assert (side[0] & ~side[1]).mean() > 0.999  # inside below, outside above
    assert np.abs(found[good] + heights[good]).mean() < 1e-3 * size
    # Whatever the guess was.
    for guess in (0 * heights, -heights, heights + 0.003 * size):
        other = tree.trace(origins, normals, guess, 1e-3 * size * full, 0.1 * size * full, 1e-4 * size)
        assert (np.abs(other - found) <= 1.2e-4 * size).mean() > 0.99


def test_rays_across_triangles_end_at_the_triangle(knot: trimesh.Trimesh) -> None:
    tree, size = WindingTree.of_triangles(knot.vertices, knot.faces), float(knot.extents.max())
    points, face = trimesh.sample.sample_surface(knot, 500, seed=5)
    normals, heights = knot.face_normals[face], np.random.default_rng(0).uniform(-0.01, 0.01, 500) * size
    full, origins = np.full(500, 1.0), points + heights[:, None] * normals
    for guess in (heights, 0.5 * heights):
        found = tree.trace(origins, normals, guess, 1e-3 * size * full, 0.1 * size * full, 1e-5 * size)
        assert np.abs(found + heights).max() < 1.1e-5 * size


def test_rays_that_meet_nothing_say_so(knot: trimesh.Trimesh) -> None:
    tree = WindingTree.of_triangles(knot.vertices, knot.faces)
    away = knot.vertices[:5] + np.array([0, 0, 1e4])
    up, ones = np.tile([0.0, 0.0, -1.0], (5, 1)), np.ones(5)
    assert np.isnan(tree.trace(away, up, ones, ones, 1e5 * ones, 1e-3)).all()
    assert np.isnan(tree.trace(np.full((5, 3), np.inf), up, ones, ones, 1e5 * ones, 1e-3)).all()
    assert tree.values(np.array([[np.inf, 0, 0], [np.nan, 0, 0]])).tolist() == [0, 0]


def test_any_number_of_equal_points_is_one_place() -> None:
    points, areas = np.ones((3000, 3)), np.tile([0.0, 0.0, 1e-3], (3000, 1))
    values = WindingTree.of_points(points, areas, np.full(3000, 0.01)).values(np.array([[1, 1, 0.0], [1, 1, 2.0]]))
    np.testing.assert_allclose(values, [3 / (4 * np.pi), -3 / (4 * np.pi)], rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)), "1 to 2"),
        ((np.full((2, 3), np.nan), np.zeros((2, 3)), np.zeros(2)), "positions: row 0 is not finite"),
        ((np.zeros((2, 3)), np.full((2, 3), np.inf), np.zeros(2)), "areas: row 0"),
        ((np.zeros((2, 3)), np.zeros((3, 3)), np.zeros(2)), "areas: need 2 rows"),
        ((np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2), 0.5), "beta"),
    ],
)
def test_bad_sources_are_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        WindingTree.of_points(*arguments)


def test_faces_out_of_range_are_refused() -> None:
    for faces in ([[0, 1, 3]], [[0, 1, -1]], np.zeros((0, 3), int)):
        with pytest.raises(ValueError, match="faces"):
            WindingTree.of_triangles(np.zeros((3, 3)), np.array(faces))


def test_real_soup_within_the_bounds_of_libigl(shared_data: Path) -> None:
    raw = read_mesh_file(shared_data / "soup" / "cow.obj")
    mesh = trimesh.Trimesh(raw.vertices, raw.faces, process=False)
    queries = near_and_far(mesh, 600)
    exact = winding_of_triangles(queries, mesh.triangles)
    values = WindingTree.of_triangles(raw.vertices, raw.faces).values(queries)
    libigl = igl.fast_winding_number(raw.vertices, raw.faces.astype(np.int64), queries)
    assert np.abs(values - exact).mean() < 1e-3
    assert np.quantile(np.abs(values - exact), 0.99) < 1e-2
    assert ((values > 0.5) == (exact > 0.5)).mean() > 0.999
    assert np.abs(values - exact).mean() < np.abs(np.asarray(libigl).ravel() - exact).mean() + 1e-3
