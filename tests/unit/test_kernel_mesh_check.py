"""`check_mesh` against `ndf_core.mesh.topology`, `measure_mesh` against plain numpy."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float, Int
from numpy import ndarray as Array
from small_assets import icosphere, open_grid, torus

from ndf_core.kernels.mesh_check import check_mesh, measure_mesh
from ndf_core.mesh import topology

TETRAHEDRON = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], np.int32)
FACES: dict[str, Int[Array, "f 3"]] = {
    "sphere": icosphere(2)[1],
    "torus": torus()[1],
    "open": open_grid()[1],
    "one face": np.array([[0, 1, 2]], np.int32),
    "two tetrahedra at a vertex": np.concatenate([TETRAHEDRON, np.where(TETRAHEDRON, TETRAHEDRON + 3, 0)]),
    "two tetrahedra at an edge": np.concatenate(
        [TETRAHEDRON, np.where(TETRAHEDRON < 2, TETRAHEDRON, TETRAHEDRON + 2)]
    ),
    "one face turned": np.concatenate([TETRAHEDRON[:3], TETRAHEDRON[3:, ::-1]]),
    "degenerate": np.array([[0, 1, 1], [1, 2, 3]], np.int32),
    "random": np.random.default_rng(0).integers(0, 40, size=(60, 3)).astype(np.int32),
    "no faces": np.zeros((0, 3), np.int32),
}


@pytest.mark.parametrize("name", FACES)
def test_counts_equal_topology(name: str) -> None:
    faces = FACES[name]
    vertices = int(faces.max(initial=-1)) + 3  # two unused at least
    check, expected = check_mesh(faces, vertices), topology(faces, vertices)
    for count in (
        "edges", "boundary_edges", "non_manifold_edges", "inconsistent_edges", "degenerate_faces", "unused_vertices"
    ):  # fmt: skip
        assert getattr(check, count) == getattr(expected, count), count
    assert check.euler_characteristic == expected.euler_characteristic
    assert check.closed == expected.closed
    assert not check.manifold  # for its unused vertices
    if not expected.non_manifold_edges + expected.inconsistent_edges + expected.degenerate_faces:
        assert check.non_manifold_vertices == expected.non_manifold_vertices
    vertices = int(faces.max(initial=-1)) + 1
    assert check_mesh(faces, vertices).manifold == topology(faces, vertices).manifold


@pytest.mark.parametrize("name", ["sphere", "torus", "open"])
def test_twins_are_twins(name: str) -> None:
    faces = FACES[name]
    twins = check_mesh(faces, int(faces.max()) + 1).twins.ravel()
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    inner = np.flatnonzero(twins >= 0)
    np.testing.assert_array_equal(twins[twins[inner]], inner)
    np.testing.assert_array_equal(start[twins[inner]], end[inner])
    np.testing.assert_array_equal(end[twins[inner]], start[inner])


def plain_shape(points: Float[Array, "n 3"], faces: Int[Array, "f 3"]) -> tuple[float, float, float]:
    """Delaunay share by angles, area and folded share, edge by edge."""
    normal = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    area = np.linalg.norm(normal, axis=1) / 2
    unit = normal / (2 * area[:, None])
    sides: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for f, face in enumerate(faces.tolist()):
        for i in range(3):
            edge = sorted((face[i], face[(i + 1) % 3]))
            sides.setdefault((edge[0], edge[1]), []).append((f, face[(i + 2) % 3]))
    inner, good, folded = 0, 0, set[int]()
    for (a, b), both in sides.items():
        if len(both) == 2:
            inner += 1
            angles = [points[[a, b]] - points[apex] for _, apex in both]
            total = sum(np.arccos(np.dot(u, v) / np.linalg.norm(u) / np.linalg.norm(v)) for u, v in angles)
            good += total <= np.pi + 1e-9
            if unit[both[0][0]] @ unit[both[1][0]] < -0.5:
                folded |= {both[0][0], both[1][0]}
    return good / inner, float(area.sum()), float(area[list(folded)].sum() / area.sum())


def test_shape_equals_plain_numpy() -> None:
    rng = np.random.default_rng(0)
    for mesh in (icosphere(2), torus(), open_grid(6)):
        points, faces = mesh
        points = points + 0.12 * rng.normal(size=points.shape)
        shape = measure_mesh(points, faces, check_mesh(faces, len(points)).twins)
        np.testing.assert_allclose(tuple(shape), plain_shape(points, faces), rtol=1e-9)
        assert 0 < shape.delaunay < 1


def test_folded_area_of_a_fold() -> None:
    """Two unit right triangles folded onto each other, and a third, flat beside one of them."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0.01], [1, -1, 0]])
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 4, 1]], np.int32)[:2]
    assert measure_mesh(points, faces, check_mesh(faces, 5).twins).folded_area == pytest.approx(1.0)
    flat = np.array([[0, 1, 2], [0, 4, 1]], np.int32)
    assert measure_mesh(points, flat, check_mesh(flat, 5).twins).folded_area == 0.0


def test_faces_without_area_and_out_of_range() -> None:
    points, faces = np.zeros((4, 3)), TETRAHEDRON
    shape = measure_mesh(points, faces, check_mesh(faces, 4).twins)
    assert shape.area == 0
    assert shape.folded_area == 0
    with pytest.raises(IndexError, match="index 3 is outside"):
        check_mesh(faces, 3)
    with pytest.raises(IndexError, match="index 3 is outside"):
        measure_mesh(points[:3], faces, check_mesh(faces, 4).twins)
