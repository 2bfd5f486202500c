"""`TriangleBVH` against trying every face, and against libigl on real meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import igl
import jaxtyping
import numpy as np
import pytest
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.reference import bvh as reference

Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]


def soup(seed: int, count: int = 60) -> Mesh:
    """Triangles of very different sizes, sharing corners now and then."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(count, 3)) * rng.choice([0.05, 1.0], size=(count, 1))
    return vertices, rng.integers(0, count, size=(2 * count, 3)).astype(np.int32)


def sphere(rings: int = 24, segments: int = 48) -> Mesh:
    """Closed unit sphere, counter-clockwise from outside."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack(
        [np.outer(np.sin(theta), f(phi)) for f in (np.cos, np.sin)]
        + [np.broadcast_to(np.cos(theta)[:, None], (rings - 1, segments))],
        axis=-1,
    )
    vertices = np.concatenate([ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    i, j = np.meshgrid(np.arange(rings - 2), np.arange(segments), indexing="ij")
    a, b = i * segments + j, i * segments + (j + 1) % segments
    c, d = a + segments, b + segments
    top, bottom = len(vertices) - 2, len(vertices) - 1
    j = np.arange(segments)
    last = (rings - 2) * segments
    faces = [np.stack(x, axis=-1).reshape(-1, 3) for x in ((a, c, b), (b, c, d))]
    faces.append(np.stack([np.full(segments, top), j, (j + 1) % segments], axis=-1))
    faces.append(np.stack([np.full(segments, bottom), last + (j + 1) % segments, last + j], axis=-1))
    return vertices, np.concatenate(faces).astype(np.int32)


def read_obj(path: Path) -> Mesh:
    vertices, faces = igl.read_triangle_mesh(str(path))
    return np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int32)


def queries(vertices: Float[Array, "v 3"], count: int, seed: int = 0) -> Float[Array, "n 3"]:
    """Around the mesh, on it, and far away."""
    rng = np.random.default_rng(seed)
    middle, size = vertices.mean(axis=0), np.ptp(vertices, axis=0).max()
    spread = np.array([0.01, 0.3, 3.0, 1e4])[rng.integers(0, 4, count)][:, None] * size
    return np.concatenate([middle + rng.normal(size=(count, 3)) * spread, vertices[:count]])


@pytest.mark.parametrize("seed", range(6))
def test_closest_agrees_with_trying_every_face(seed: int) -> None:
    vertices, faces = soup(seed)
    points = queries(vertices, 300)
    found, face, weights = TriangleBVH(vertices, faces).closest(points)
    _, distance = reference.closest(points, vertices, faces)
    scale = np.maximum(np.abs(points).max(axis=1), 1)
    assert np.all(np.abs(np.linalg.norm(found - points, axis=1) - distance) <= 4e-15 * scale)
    assert np.all(weights >= 0)
    assert np.allclose(weights.sum(axis=1), 1, rtol=0, atol=1e-15)
    assert np.allclose(np.einsum("ij,ijk->ik", weights, vertices[faces[face]]), found, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["rocker-arm.obj", "fandisk.obj"])
def test_closest_agrees_with_libigl_on_real_meshes(name: str, shared_data: Path) -> None:
    vertices, faces = read_obj(shared_data / "mesh" / name)
    size = np.ptp(vertices, axis=0).max()
    rng = np.random.default_rng(1)
    near = vertices[faces[rng.integers(0, len(faces), 4000)]].mean(axis=1) + rng.normal(size=(4000, 3)) * 0.01 * size
    points = np.concatenate([near, queries(vertices, 500)])
    found, _, _ = TriangleBVH(vertices, faces).closest(points)
    squared, _, theirs = igl.point_mesh_squared_distance(points, vertices, faces.astype(np.int64))
    distance = np.linalg.norm(found - points, axis=1)
    assert np.all(np.abs(distance - np.sqrt(squared)) <= 1e-14 * (distance + size))
    agree = np.linalg.norm(found - theirs, axis=1) <= 1e-7 * size
    assert agree[: len(near)].mean() > 0.999  # two points may be equally close


def test_corners_come_back_exactly() -> None:
    vertices, faces = soup(3)
    vertices = vertices * 1e-3 + [123.456, -1e5, 7.0]
    used = vertices[np.unique(faces)]
    found, _, weights = TriangleBVH(vertices, faces).closest(used)
    assert np.array_equal(found, used)
    assert set(np.unique(weights)) == {0.0, 1.0}


@pytest.mark.parametrize("threads", [1, 3])
def test_answers_depend_on_nothing_but_the_query(threads: int) -> None:
    vertices, faces = sphere()
    tree = TriangleBVH(vertices, faces)
    points = np.concatenate([queries(vertices, 4000), np.zeros((50, 3))])
    whole = tree.closest(points)
    order = np.random.default_rng(0).permutation(len(points))
    for part, expected in zip(tree.closest(points[order], threads=threads), whole, strict=True):
        assert np.array_equal(part, expected[order])
    for i in range(0, len(points), 97):
        for part, expected in zip(tree.closest(points[i : i + 1]), whole, strict=True):
            assert np.array_equal(part[0], expected[i])


def test_equal_distances_go_to_the_smallest_face() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    faces = np.tile([[0, 1, 2]], (40, 1))
    found = TriangleBVH(vertices, faces).closest(np.array([[0.2, 0.2, 3.0], [9, 9, 9]]))[1]
    assert found.tolist() == [0, 0]


def test_the_order_of_the_faces_changes_no_distance() -> None:
    vertices, faces = soup(5)
    points = queries(vertices, 500)
    order = np.random.default_rng(0).permutation(len(faces))
    one = TriangleBVH(vertices, faces).closest(points)
    two = TriangleBVH(vertices, faces[order]).closest(points)
    distances = [np.linalg.norm(found - points, axis=1) for found in (one[0], two[0])]
    assert np.allclose(distances[0], distances[1], rtol=4e-16, atol=1e-15)


@pytest.mark.parametrize(("offset", "size"), [(0, 1e-6), (1e6, 1), (1e6, 1e6), (0, 1e-150), (0, 1e140), (1e-3, 1e-6)])
def test_offset_and_size_cost_only_the_rounding_of_the_coordinates(offset: float, size: float) -> None:
    vertices, faces = soup(1)
    points = queries(vertices, 200)
    moved = vertices * size + offset
    found, _, weights = TriangleBVH(moved, faces).closest(points * size + offset)
    _, expected = reference.closest(points, vertices, faces)
    distance = np.linalg.norm((found - (points * size + offset)) / size, axis=1)
    rounding = 4e-15 * (np.abs(points).max(axis=1) + 1 + abs(offset) / size)
    assert np.all(np.abs(distance - expected) <= rounding)
    assert np.all(np.isfinite(weights))


def test_degenerate_faces_are_segments_and_points() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 5, 5], [0.3, 0, 0]])
    faces = np.array([[0, 1, 2], [3, 3, 3], [0, 2, 4], [0, 0, 2]])
    points = np.array([[0.5, 1, 0], [1.75, -2, 0], [-1, 0, 0], [5, 5, 6], [3, 0, 0.5]])
    found, _, weights = TriangleBVH(vertices, faces).closest(points)
    assert np.allclose(found, [[0.5, 0, 0], [1.75, 0, 0], [0, 0, 0], [5, 5, 5], [2, 0, 0]], rtol=0, atol=1e-15)
    assert np.all(weights >= 0)


@pytest.mark.parametrize("height", [1e-5, 1e-9, 1e-13, 1e-17])
def test_slivers_are_measured_to_points_that_they_have(height: float) -> None:
    rng = np.random.default_rng(0)
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.4, height, 0]]) @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = rng.normal(size=(2000, 3))
    found, _, _ = TriangleBVH(vertices, np.array([[0, 1, 2]])).closest(points)
    along = np.clip(points @ vertices[1], 0, 1)[:, None] * vertices[1]
    assert np.all(np.linalg.norm(found - points, axis=1) <= np.linalg.norm(along - points, axis=1) + 1e-15)
    assert np.all(
        np.linalg.norm(found - points, axis=1) >= np.linalg.norm(along - points, axis=1) - 2 * height - 1e-15
    )


def test_many_equal_faces_and_a_long_chain_of_scales_are_built() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    scales = np.repeat(2.0 ** -np.arange(400), 3)[:, None]
    chain = np.tile(vertices, (400, 1)) * scales
    faces = np.concatenate([np.arange(1200).reshape(-1, 3), np.zeros((5000, 3), int)])
    found, face, _ = TriangleBVH(chain, faces).closest(np.array([[3.0, 0, 0], [0, 0, 1]]))
    assert np.allclose(found, [[1, 0, 0], [0, 0, 0]], rtol=0, atol=1e-15)
    assert face.tolist() == [0, 0]


@pytest.mark.parametrize("seed", range(4))
def test_first_hit_agrees_with_trying_every_face(seed: int) -> None:
    vertices, faces = soup(seed)
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(500, 3)) * 2
    directions = rng.normal(size=(500, 3)) * 10.0 ** rng.integers(-8, 8, size=(500, 1))
    directions[:60] = np.repeat(np.eye(3) * [1, -1, 1], 20, axis=0)
    t, face = TriangleBVH(vertices, faces).first_hit(origins, directions)
    expected, expected_face = reference.first_hit(origins, directions, vertices, faces)
    hit = np.isfinite(expected)
    assert np.array_equal(np.isfinite(t), hit)
    assert 50 < hit.sum() < 450
    assert np.allclose(t[hit], expected[hit], rtol=1e-9)
    assert np.array_equal(face[~hit], np.full((~hit).sum(), -1))
    assert (face == expected_face).mean() > 0.95  # degenerate copies of a face may tie


def test_rays_through_shared_corners_and_edges_do_not_slip_through() -> None:
    vertices, faces = sphere()
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    vertices = vertices @ turn * 3 + 100
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    share = np.linspace(0, 1, 7)[:, None, None]
    targets = (vertices[start] * (1 - share) + vertices[end] * share).reshape(-1, 3)
    origin = vertices[faces].mean(axis=(0, 1))
    directions = targets - origin
    t, face = TriangleBVH(vertices, faces).first_hit(np.broadcast_to(origin, targets.shape), directions)
    assert np.all(face >= 0)
    assert np.allclose(t, 1, rtol=0, atol=1e-9)


def test_hits_are_the_same_for_any_number_of_threads() -> None:
    vertices, faces = sphere()
    tree = TriangleBVH(vertices, faces)
    rng = np.random.default_rng(0)
    origins, directions = rng.normal(size=(2, 5000, 3))
    for one, two in zip(
        tree.first_hit(origins, directions), tree.first_hit(origins, directions, threads=4), strict=True
    ):
        assert np.array_equal(one, two)


BAD_MESHES: list[tuple[Callable[[Float[Array, "v 3"], Int[Array, "f 3"]], object], str]] = [
    (lambda v, f: TriangleBVH(v, f[:0]), "need 1 to"),
    (lambda v, f: TriangleBVH(v, f + 1), "faces: row 0 names a vertex outside 0..2"),
    (lambda v, f: TriangleBVH(v, f - 1), "faces: row 0 names a vertex outside"),
    (lambda v, f: TriangleBVH(v * np.nan, f), "vertices: row 0 is not finite"),
    (lambda v, f: TriangleBVH(v + np.inf, f), "vertices: row 0 is not finite"),
    (lambda v, f: TriangleBVH(v[:, :2], f), "vertices: need an array"),
    (lambda v, f: TriangleBVH(v, f.astype(float)), "faces: need an integer array"),
    (lambda v, f: TriangleBVH(v, f).closest(np.array([[0, 0, 0], [0, np.nan, 0]])), "queries: row 1 is not finite"),
    (lambda v, f: TriangleBVH(v, f).closest(v[0]), "queries: need an array"),
    (lambda v, f: TriangleBVH(v, f).closest(v, threads=0), "threads: need at least 1"),
    (lambda v, f: TriangleBVH(v, f).first_hit(v, v * 0), "directions: row 0 is zero"),
    (lambda v, f: TriangleBVH(v, f).first_hit(v, v[:1] + 1), "directions: need 3 rows"),
    (lambda v, f: TriangleBVH(v, f).first_hit(v * np.inf, v), "origins: row 0 is not finite"),
    (lambda v, f: TriangleBVH(v, f).self_intersections(limit=-1), "limit: need at least 0"),
]


@pytest.fixture
def no_shape_checks() -> Iterator[None]:
    """What a user sees, whose arrays jaxtyping does not check."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.usefixtures("no_shape_checks")
@pytest.mark.parametrize(("call", "message"), BAD_MESHES)
def test_bad_arguments_are_named(
    call: Callable[[Float[Array, "v 3"], Int[Array, "f 3"]], object], message: str
) -> None:
    with np.errstate(invalid="ignore"), pytest.raises(ValueError, match=message):
        call(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def test_no_query_gives_no_answer() -> None:
    vertices, faces = sphere(6, 8)
    tree = TriangleBVH(vertices, faces)
    assert [part.shape for part in tree.closest(np.zeros((0, 3)))] == [(0, 3), (0,), (0, 3)]
    assert [part.shape for part in tree.first_hit(np.zeros((0, 3)), np.zeros((0, 3)))] == [(0,), (0,)]
