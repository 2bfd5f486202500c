"""`check_base_mesh` accepts sound meshes and names every fault of the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from solids import box, hollow_ball, mesh_of, sheet, tetrahedron, two_balls

from ndf_core.base_mesh.checks import check_base_mesh, inside_out_components, winding_number
from ndf_core.base_mesh.split import even_edge_length, split_long_edges
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh
from ndf_core.mesh import face_components, face_normals, topology

Mesh = tuple[np.ndarray, np.ndarray]


@pytest.mark.parametrize("make", [tetrahedron, box, lambda: mesh_of(hollow_ball, 16), lambda: mesh_of(two_balls, 24)])
def test_sound_meshes_pass(make: Callable[[], Mesh]) -> None:
    vertices, faces = make()
    counts = topology(faces, len(vertices))
    assert check_base_mesh(BaseMesh(vertices, faces), components=counts.components) == counts


def test_a_sheet_passes_where_a_boundary_is_allowed() -> None:
    mesh = BaseMesh(*sheet(3))
    assert check_base_mesh(mesh, closed=False).boundary_edges == 12
    with pytest.raises(BaseMeshError, match="12 boundary edges"):
        check_base_mesh(mesh)


def _with(vertices: np.ndarray | None = None, faces: np.ndarray | None = None) -> BaseMesh:
    good = tetrahedron()
    return BaseMesh(good[0] if vertices is None else vertices, good[1] if faces is None else faces)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (_with(faces=np.zeros((0, 3), np.int32)), "empty"),
        (_with(vertices=np.full((4, 3), np.nan)), "4 vertices are not finite"),
        (_with(faces=tetrahedron()[1] + 1), "does not exist"),
        (_with(faces=tetrahedron()[1][:, ::-1].copy()), "1 of its components are inside out"),
        (_with(faces=np.r_[tetrahedron()[1][:3], [[2, 3, 0]]].astype(np.int32)), "3 edges between oppositely"),
        (_with(vertices=tetrahedron()[0] * [1, 1, 0]), "2 faces have no area"),
        (_with(vertices=tetrahedron()[0] * [1, 0, 0]), "4 faces have no area"),
        (_with(vertices=np.r_[tetrahedron()[0], [[5.0, 5, 5]]]), "1 unused vertices"),
    ],
)
def test_faults_are_named(mesh: BaseMesh, message: str) -> None:
    with pytest.raises(BaseMeshError, match=message):
        check_base_mesh(mesh)


def test_every_fault_is_named_at_once() -> None:
    with pytest.raises(BaseMeshError, match="Euler characteristic is 2, .* 0; its number of components is 1, .* 3"):
        check_base_mesh(_with(), euler_characteristic=0, components=3)


def test_winding_number_counts_shells() -> None:
    vertices, faces = mesh_of(hollow_ball, 24)
    for point, expected in (((0.0, 0, 0), 0), ((0.8, 0, 0), 1), ((1.4, 0, 0), 0)):
        assert winding_number(np.array(point), vertices, faces) == pytest.approx(expected, abs=1e-9)


def test_only_shells_that_bound_no_cavity_are_inside_out() -> None:
    vertices, faces = mesh_of(hollow_ball, 24)
    assert not len(inside_out_components(vertices, faces))
    vertices, faces = mesh_of(two_balls, 24)
    label = face_components(faces, len(vertices))
    faces[label == 1] = faces[label == 1][:, ::-1]
    assert inside_out_components(vertices, faces).tolist() == [1]


def test_splitting_keeps_the_surface() -> None:
    vertices, faces = box((1.0, 0.3, 0.01))
    length = even_edge_length(vertices, faces, 500)
    points, corners = split_long_edges(vertices, faces, length, 100_000)
    edges = points[corners] - points[np.roll(corners, -1, axis=1)]
    assert (np.linalg.norm(edges, axis=2) <= length).all()
    before, after = topology(faces, len(vertices)), topology(corners, len(points))
    assert after.manifold and after.closed and after.euler_characteristic == before.euler_characteristic
    assert np.array_equal(points[: len(vertices)], vertices)
    areas = [np.linalg.norm(face_normals(v, f), axis=1).sum() for v, f in ((vertices, faces), (points, corners))]
    assert areas[1] == pytest.approx(areas[0], rel=1e-12)
    # On the box: every point lies on one of its six planes and within its sides.
    on = np.isclose(points, 0, atol=1e-15) | np.isclose(points, [1.0, 0.3, 0.01], atol=1e-15)
    assert on.any(axis=1).all()


def test_splitting_stops_at_the_limit() -> None:
    _, corners = split_long_edges(*box(), 1e-3, 1000)
    assert 12 < len(corners) <= 1000
