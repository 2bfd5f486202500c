"""Laws of the decimation kernel: topology never changes, shapes stay sound, the surface stays near."""

from __future__ import annotations

from collections.abc import Callable

import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import ball, box, bumpy, hollow_ball, mesh_of, min_angles, sheet, tetrahedron, torus, two_balls

from ndf_core.base_mesh.checks import altitudes
from ndf_core.base_mesh.split import split_long_edges
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.decimate import decimate
from ndf_core.mesh import face_normals, signed_volume, topology

SOLIDS: dict[str, Callable[..., np.ndarray]] = {
    "bumpy": bumpy,
    "torus": torus,
    "two balls": two_balls,
    "hollow ball": hollow_ball,
}


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("max_faces", [10, 60, 400, 2000])
def test_topology_stays(name: str, max_faces: int) -> None:
    vertices, faces = mesh_of(SOLIDS[name])
    before = topology(faces, len(vertices))
    points, corners, cluster = decimate(vertices, faces, max_faces)
    after = topology(corners, len(points))
    assert after.manifold and after.closed
    assert (after.euler_characteristic, after.components) == (before.euler_characteristic, before.components)
    assert len(corners) <= max(max_faces, 40)
    assert np.array_equal(np.unique(cluster), np.arange(len(points)))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(4, 600))
def test_topology_stays_on_random_surfaces(seed: int, max_faces: int) -> None:
    values = np.random.default_rng(seed).normal(size=(6, 6, 6))
    vertices, faces = mesh_of(lambda p: values[tuple(np.clip(((p + 1.5) * 2).astype(int), 0, 5).T)], 12)
    before = topology(faces, len(vertices))
    points, corners, _ = decimate(vertices, faces, max_faces)
    after = topology(corners, len(points))
    assert after.manifold and after.closed
    assert (after.euler_characteristic, after.components) == (before.euler_characteristic, before.components)
    assert (altitudes(points, corners) > 0).all()


def test_boundary_loops_stay() -> None:
    vertices, faces = sheet(24)
    middle = vertices[faces].mean(axis=1)
    faces = faces[np.abs(middle[:, :2] - 0.5).max(axis=1) > 0.2]  # a square hole: an annulus
    points, corners, _ = decimate(vertices, faces, 60)
    after = topology(corners, len(points))
    assert after.manifold and after.components == 1 and after.euler_characteristic == 0
    assert len(corners) <= 60 and not after.closed
    # Flat stays flat, and the outline stays where it is.
    assert np.abs(points[:, 2]).max() < 1e-12
    area = 0.5 * np.linalg.norm(face_normals(points, corners), axis=1).sum()
    expected = 0.5 * np.linalg.norm(face_normals(*_used(vertices, faces)), axis=1).sum()
    assert area == pytest.approx(expected, rel=5e-3)


def test_smallest_meshes_are_left_alone() -> None:
    vertices, faces = tetrahedron()
    points, corners, _ = decimate(vertices, faces, 1)
    assert np.array_equal(points, vertices) and np.array_equal(corners, faces)
    points, corners, _ = decimate(*mesh_of(ball, 16), 1)
    assert len(corners) == 4
    points, corners, _ = decimate(*mesh_of(torus), 1)
    assert len(corners) >= 14  # the fewest that a triangulated torus can have (Moebius, Csaszar)


def test_enough_faces_changes_nothing() -> None:
    vertices, faces = mesh_of(torus, 16)
    points, corners, cluster = decimate(vertices, faces, len(faces))
    assert np.array_equal(points, vertices) and np.array_equal(corners, faces)
    assert np.array_equal(cluster, np.arange(len(vertices)))


def test_unused_vertices_are_dropped() -> None:
    vertices, faces = tetrahedron()
    points, corners, cluster = decimate(np.r_[[[9.0, 9, 9]], vertices], faces + 1, 4)
    assert np.array_equal(points, vertices) and np.array_equal(corners, faces)
    assert cluster.tolist() == [-1, 0, 1, 2, 3]


def test_same_result_wherever_and_however_large() -> None:
    vertices, faces = mesh_of(bumpy)
    points, corners, _ = decimate(vertices, faces, 300)
    again = decimate(vertices, faces, 300)
    assert np.array_equal(points, again.vertices) and np.array_equal(corners, again.faces)
    # A power of two scales without rounding, so everything stays the same to the last bit.
    scaled = decimate(vertices * 2.0**-20, faces, 300)
    assert np.array_equal(scaled.vertices, points * 2.0**-20) and np.array_equal(scaled.faces, corners)
    moved = decimate(vertices * 1e-6 + 1e3, faces, 300)
    tree = TriangleBVH(vertices, faces)
    error, moved_error = (
        np.linalg.norm(tree.closest(x)[0] - x, axis=1).mean() for x in (points, (moved.vertices - 1e3) * 1e6)
    )
    assert moved_error == pytest.approx(error, rel=0.2)


def test_arguments_are_not_changed() -> None:
    vertices, faces = mesh_of(torus, 16)
    before = vertices.copy(), faces.copy()
    decimate(vertices, faces, 100)
    assert np.array_equal(vertices, before[0]) and np.array_equal(faces, before[1])


@pytest.mark.parametrize("name", ["bumpy", "torus"])
def test_as_near_as_qslim_with_better_triangles(name: str) -> None:
    """libigl's qslim is the independent reference for accuracy."""
    vertices, faces = mesh_of(SOLIDS[name], 48)
    points, corners, _ = decimate(vertices, faces, 800)
    reference = igl.qslim(vertices, faces.astype(np.int64), 800, True)
    others = np.ascontiguousarray(reference[0]), np.ascontiguousarray(reference[1], dtype=np.int32)
    assert _distance(vertices, faces, points, corners) < 1.35 * _distance(vertices, faces, *others)
    mine, theirs = min_angles(points, corners), min_angles(*others)
    assert np.percentile(mine, 2) > np.percentile(theirs, 2)
    assert np.percentile(mine, 2) > 12


def test_needles_become_even_triangles() -> None:
    vertices, faces = split_long_edges(*box((1.0, 0.5, 0.2)), 0.03, 100_000)
    points, corners, _ = decimate(vertices, faces, 600)
    angles = min_angles(points, corners)
    assert np.percentile(angles, 5) > 15 and np.median(angles) > 33
    area = 0.5 * np.linalg.norm(face_normals(points, corners), axis=1)
    assert np.percentile(area, 95) < 8 * np.percentile(area, 5)
    assert signed_volume(points, corners) == pytest.approx(0.1, rel=5e-3)


def test_weights_keep_faces() -> None:
    vertices, faces = mesh_of(ball, 32)
    weights = np.where(vertices[:, 0] > 0, 100.0, 1.0)
    points, _, _ = decimate(vertices, faces, 500, weights=weights)
    assert (points[:, 0] > 0).mean() > 0.7


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ([[0, 1, 2], [0, 1, 3]], "manifold"),  # two faces run through an edge in the same direction
        ([[0, 1, 2], [1, 0, 3], [0, 1, 4]], "manifold"),
        ([[0, 1, 1]], "manifold"),
        ([[0, 1, 2], [0, 3, 4]], "manifold"),  # two fans at a vertex
        ([[0, 1, 5]], "range"),
        ([[0, 1, -1]], "range"),
    ],
)
def test_what_is_not_manifold_is_refused(faces: list[list[int]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decimate(np.random.default_rng(0).normal(size=(5, 3)), np.array(faces), 1)


def test_bad_numbers_are_refused() -> None:
    vertices, faces = tetrahedron()
    with pytest.raises(ValueError, match="finite"):
        decimate(np.where(vertices == 1, np.nan, vertices), faces, 4)
    with pytest.raises(ValueError, match="weights"):
        decimate(vertices, faces, 4, weights=np.zeros(4))
    with pytest.raises(ValueError, match="length"):
        decimate(vertices, faces, 4, weights=np.ones(3))


def _used(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    used, corners = np.unique(faces, return_inverse=True)
    return vertices[used], corners.reshape(-1, 3)


def _distance(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, corners: np.ndarray) -> float:
    """Root mean square distance of the middles of `corners` from the mesh, by area."""
    middle = points[corners].mean(axis=1)
    weight = np.linalg.norm(face_normals(points, corners), axis=1)
    squared = ((TriangleBVH(vertices, faces).closest(middle)[0] - middle) ** 2).sum(axis=1)
    return float(np.sqrt((weight * squared).sum() / weight.sum()))
