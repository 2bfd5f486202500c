"""The intrinsic Delaunay triangulation: against planar Delaunay, against the reference, and its laws."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import Delaunay
from small_assets import Mesh, icosphere, open_grid, torus

from ndf_core.errors import InputError
from ndf_core.extract.intrinsic_delaunay import intrinsic_delaunay
from ndf_core.kernels.delaunay import IntrinsicTriangulation, delaunay_share, flip_to_delaunay, straight_lengths
from ndf_core.kernels.mesh_check import check_mesh
from ndf_core.kernels.reference import delaunay as reference


def stretched(mesh: Mesh, seed: int, factor: float = 6.0) -> Mesh:
    """Noisy and drawn out, so that many edges have to flip."""
    vertices, faces = mesh
    rng = np.random.default_rng(seed)
    return (vertices + rng.normal(size=vertices.shape) * 0.05) * np.array([factor, 1.0, 1.0]), faces


MESHES = {
    "sphere": stretched(icosphere(2), 1),
    "torus": stretched(torus(20, 8), 2),
    "open": stretched(open_grid(7), 3, 20.0),
    "few": stretched(icosphere(0), 4, 30.0),  # ends in loops and double edges
}


def angles(triangulation: IntrinsicTriangulation) -> Float[Array, "f 3"]:
    """At each corner, by the law of cosines."""
    ahead, opposite, behind = (np.roll(triangulation.lengths, -i, axis=1) for i in range(3))
    return np.arccos(np.clip((ahead**2 + behind**2 - opposite**2) / (2 * ahead * behind), -1, 1))


def at_vertices(triangulation: IntrinsicTriangulation, count: int) -> Float[Array, " v"]:
    return np.bincount(triangulation.faces.ravel(), angles(triangulation).ravel(), minlength=count)


def area(triangulation: IntrinsicTriangulation) -> float:
    a, b, c = triangulation.lengths.T
    return float(np.sqrt((a + b + c) * (b + c - a) * (c + a - b) * (a + b - c)).sum() / 4)


def unflipped(vertices: Float[Array, "v 3"], faces: Array) -> IntrinsicTriangulation:
    lengths = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=2)
    return IntrinsicTriangulation(faces, lengths, check_mesh(faces, len(vertices)).twins)


@pytest.mark.parametrize("name", MESHES)
def test_agrees_with_the_reference(name: str) -> None:
    """The triangulation is unique where no four corners lie on a circle."""
    vertices, faces = MESHES[name]
    found = intrinsic_delaunay(vertices, faces)
    triangles = [
        reference.canonical(*rows) for rows in zip(found.faces.tolist(), found.lengths.tolist(), strict=True)
    ]
    assert sorted(triangles) == reference.flip_to_delaunay(vertices, faces, check_mesh(faces, len(vertices)).twins)


@pytest.mark.parametrize("name", MESHES)
def test_surface_stays_and_every_edge_is_delaunay(name: str) -> None:
    vertices, faces = MESHES[name]
    before, after = unflipped(vertices, faces), intrinsic_delaunay(vertices, faces)
    assert delaunay_share(before) < 0.9
    assert delaunay_share(after, least=-2e-9) == 1.0
    assert area(after) == pytest.approx(area(before), rel=1e-12)
    np.testing.assert_allclose(at_vertices(after, len(vertices)), at_vertices(before, len(vertices)), atol=1e-7)
    opposite = np.roll(angles(after), -2, axis=1).ravel()
    inner = after.twins.ravel() >= 0
    assert (opposite[inner] + opposite[after.twins.ravel()[inner]] <= np.pi + 1e-7).all()
    np.testing.assert_array_equal(after.lengths.ravel()[inner], after.lengths.ravel()[after.twins.ravel()[inner]])
    np.testing.assert_array_equal(after.twins.ravel()[after.twins.ravel()[inner]], np.flatnonzero(inner))


def test_repeatable_and_idempotent() -> None:
    vertices, faces = MESHES["torus"]
    one, two = intrinsic_delaunay(vertices, faces), intrinsic_delaunay(vertices, faces)
    for name in IntrinsicTriangulation._fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    evenly = icosphere(3)
    np.testing.assert_array_equal(intrinsic_delaunay(*evenly).faces, evenly[1])


def test_loops_and_double_edges_occur() -> None:
    faces = intrinsic_delaunay(*MESHES["few"]).faces
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] > 2).any() or (edges[:, 0] == edges[:, 1]).any()


@pytest.mark.parametrize("seed", range(5))
def test_planar_meshes_become_the_delaunay_triangulation_of_their_points(seed: int) -> None:
    """From any triangulation: here that of the same points drawn out a hundredfold."""
    points = np.random.default_rng(seed).random((300, 2))
    start = Delaunay(points * np.array([100.0, 1.0]))
    faces = start.simplices.astype(np.int32)
    corners = points[faces]
    turned = np.linalg.det(np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)) < 0
    faces[turned] = faces[turned][:, ::-1]
    found = intrinsic_delaunay(np.column_stack([points, np.zeros(300)]), faces)
    assert {tuple(sorted(face)) for face in found.faces.tolist()} == {
        tuple(sorted(face)) for face in Delaunay(points).simplices.tolist()
    }


def test_needles_of_a_millionth_of_a_degree_and_flat_faces() -> None:
    """A fan of needles around one vertex, and faces without any area, end and are Delaunay."""
    turn = np.linspace(0, 2e-6, 60)
    fan = np.concatenate([np.zeros((1, 3)), np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)])
    faces = np.stack([np.zeros(59, int), np.arange(1, 60), np.arange(2, 61)], axis=1).astype(np.int32)
    assert delaunay_share(intrinsic_delaunay(fan * 1e9, faces)) == 1.0
    flat, flat_faces = open_grid(6)
    flat = flat * np.array([1.0, 0.0, 0.0])
    assert delaunay_share(intrinsic_delaunay(flat, flat_faces)) == 1.0
    assert delaunay_share(intrinsic_delaunay(flat * 0, flat_faces)) == 1.0


def test_faulty_meshes_are_named() -> None:
    vertices, faces = icosphere(0)
    with pytest.raises(InputError, match="3 edges of more than two faces"):
        intrinsic_delaunay(vertices, np.concatenate([faces, faces[:1]]))
    with pytest.raises(InputError, match="index 12 is outside"):
        intrinsic_delaunay(vertices, faces + np.int32(1))
    with pytest.raises(InputError, match="1 degenerate faces"):
        intrinsic_delaunay(vertices, np.array([[0, 1, 1]], np.int32))
    with pytest.raises(InputError, match="not finite"):
        intrinsic_delaunay(vertices * np.nan, faces)


def test_the_kernel_refuses_twins_that_are_not_pairs() -> None:
    vertices, faces = icosphere(0)
    twins = check_mesh(faces, 12).twins
    with pytest.raises(ValueError, match="half-edge 0 has no other side"):
        flip_to_delaunay(straight_lengths(vertices, faces), faces, np.where(twins == twins[0, 0], 0, twins))
    with pytest.raises(ValueError, match="same number of rows"):
        flip_to_delaunay(straight_lengths(vertices, faces), faces, twins[1:])
    with pytest.raises(ValueError, match="not those of these faces"):
        delaunay_share(IntrinsicTriangulation(faces, np.ones((20, 3)), twins + np.int32(100)))
