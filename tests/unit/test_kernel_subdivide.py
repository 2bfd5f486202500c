"""Subdivision against the face-by-face reference, and flips against what they promise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from jaxtyping import Float, Int
from numpy import ndarray as Array
from small_assets import icosphere, open_grid, torus

from ndf_core.kernels.mesh_check import check_mesh, measure_mesh
from ndf_core.kernels.reference import subdivide as reference
from ndf_core.kernels.subdivide import (
    BasePoints,
    Triangulation,
    flip_edges,
    mark_long_edges,
    place_midpoints,
    split_faces,
)

Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]
MESHES: dict[str, Mesh] = {"sphere": icosphere(1), "torus": torus(), "open": open_grid()}


class State:
    """A mesh under subdivision whose map is a given function of the base point's position."""

    def __init__(self, mesh: Mesh, bend: Callable[[Array], Array]) -> None:
        self.vertices, base = mesh
        self.bend = bend
        twins = check_mesh(base, len(self.vertices)).twins
        faces = np.empty(len(self.vertices), np.int32)
        faces[base.ravel()] = np.repeat(np.arange(len(base), dtype=np.int32), 3)
        weights = (base[faces] == np.arange(len(self.vertices))[:, None]).astype(np.float64)
        self.mesh = Triangulation(base.copy(), twins, np.arange(len(base), dtype=np.int32))
        self.points = BasePoints(base, faces, weights)

    @property
    def positions(self) -> Float[Array, "n 3"]:
        """Where the vertices lie on the base mesh."""
        _, faces, weights = self.points
        return np.einsum("nk,nkc->nc", weights, self.vertices[self.points.base_faces[faces]])

    @property
    def mapped(self) -> Float[Array, "n 3"]:
        return np.ascontiguousarray(self.bend(self.positions))

    def split(self, limit: float) -> bool:
        midpoint, count = mark_long_edges(self.mesh, self.mapped, self.positions, limit)
        faces, weights = place_midpoints(self.mesh, midpoint, count, self.points)
        self.points = BasePoints(
            self.points.base_faces,
            np.concatenate([self.points.faces, faces]),
            np.concatenate([self.points.barycentric, weights]),
        )
        self.mesh = split_faces(self.mesh, midpoint, self.mapped)
        return count > 0


def wavy(points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Stretches unevenly, so that all patterns occur."""
    return points + 0.3 * np.sin(3.0 * points[:, [1, 2, 0]]) * points[:, [2, 0, 1]]


def canonical(faces: Int[Array, "f 3"]) -> set[tuple[int, int, int]]:
    """Faces as turned so that the smallest vertex comes first."""
    turned = set[tuple[int, int, int]]()
    for face in faces.tolist():
        i = face.index(min(face))
        turned.add((face[i], face[(i + 1) % 3], face[(i + 2) % 3]))
    assert len(turned) == len(faces)
    return turned


@pytest.mark.parametrize("mesh", MESHES)
def test_equal_to_reference(mesh: str) -> None:
    state = State(MESHES[mesh], wavy)
    for limit in (0.5, 0.3, 0.22, 0.15):
        before, corners, count = state.mapped, state.mesh.corners, len(state.mapped)
        middles = reference.long_edges(corners, before, state.positions, limit)
        assert state.split(limit) == bool(middles)
        mapped = state.mapped
        assert len(mapped) == count + len(middles)
        positions = state.positions
        for (a, b), vertex in middles.items():
            np.testing.assert_allclose(positions[vertex], (positions[a] + positions[b]) / 2, rtol=0, atol=1e-15)
        expected = [child for face in corners for child in reference.split_face(face, middles, mapped)]
        assert canonical(state.mesh.corners) == canonical(np.array(expected))
        np.testing.assert_array_equal(check_mesh(state.mesh.corners, len(mapped)).twins, state.mesh.twins)


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("flips", [False, True])
def test_every_face_covers_its_part_of_its_base_face(mesh: str, flips: bool) -> None:
    """The homes partition the base mesh: positive areas that add up to each base face."""
    state = State(MESHES[mesh], wavy)
    for limit in (0.4, 0.2, 0.1, 0.1, 0.1):
        state.split(limit)
        if flips:
            flip_edges(state.mesh, state.mapped, state.points, limit, 3)
    base_faces, own, weights = state.points
    total = np.zeros(len(base_faces))
    for face, home in zip(state.mesh.corners, state.mesh.home, strict=True):
        corner = [reference.weights_in(base_faces, int(home), int(own[v]), weights[v]) for v in face]
        assert all(w.sum() == 1.0 for w in corner)
        area = np.linalg.det(np.array(corner))
        assert area > 0
        total[home] += area
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)


@pytest.mark.parametrize("mesh", MESHES)
def test_flips_bring_delaunay_edges_and_change_no_topology(mesh: str) -> None:
    state = State(MESHES[mesh], wavy)
    limit = 0.05
    while state.split(limit):
        pass
    mapped = state.mapped
    before = check_mesh(state.mesh.corners, len(mapped))
    share = measure_mesh(mapped, state.mesh.corners, state.mesh.twins).delaunay
    assert flip_edges(state.mesh, mapped, state.points, limit, 10) > 0
    after = check_mesh(state.mesh.corners, len(mapped))
    np.testing.assert_array_equal(after.twins, state.mesh.twins)
    assert after[1:] == before[1:]
    assert measure_mesh(mapped, state.mesh.corners, after.twins).delaunay > share
    assert mark_long_edges(state.mesh, mapped, state.positions, limit)[1] == 0
    assert flip_edges(state.mesh, mapped, state.points, limit, 10) == 0


def test_flips_inside_a_flat_base_face_reach_delaunay() -> None:
    """A large triangle, split evenly and then sheared by its map: every inner edge is inside the only base face."""
    triangle = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.3, 1.0, 0.0]]), np.array([[0, 1, 2]], np.int32)
    state = State(triangle, lambda points: points)
    while state.split(0.11):
        pass
    state.bend = lambda points: points @ np.array([[1.0, 0.0, 0.0], [2.5, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert measure_mesh(state.mapped, state.mesh.corners, state.mesh.twins).delaunay < 0.9
    assert flip_edges(state.mesh, state.mapped, state.points, 1e9, 200) > 500
    assert measure_mesh(state.mapped, state.mesh.corners, state.mesh.twins).delaunay == 1.0


def test_an_edge_whose_ends_meet_is_split_too() -> None:
    """The map rolls the edge from x = -1 to x = 1 up into a circle that just fails to close. The edge seems short all
    the time, but the faces beside it can only be split to the end together with it."""

    def rolled(points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        angle = 0.995 * np.pi * points[:, 0]
        return np.stack([np.cos(angle), np.sin(angle), points[:, 1]], axis=1)

    corners = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0.1, 0.5, 0], [-0.2, -0.6, 0]])
    state = State((corners, np.array([[0, 1, 2], [1, 0, 3]], np.int32)), rolled)
    rounds = 0
    while state.split(0.08):
        flip_edges(state.mesh, state.mapped, state.points, 0.08, 3)
        rounds += 1
        assert rounds < 12
    area = measure_mesh(state.mapped, state.mesh.corners, state.mesh.twins).area
    assert len(state.mapped) < 8 * area / 0.08**2  # an even mesh has 2 to 3 in place of 8


def test_indices_out_of_range_are_refused() -> None:
    state = State(MESHES["sphere"], wavy)
    mapped, base = state.mapped, state.positions
    midpoint, count = mark_long_edges(state.mesh, mapped, base, 0.5)
    with pytest.raises(IndexError, match="corners"):
        mark_long_edges(state.mesh, mapped[:-1], base[:-1], 0.5)
    with pytest.raises(IndexError, match="twins"):
        mark_long_edges(state.mesh._replace(twins=state.mesh.twins + 400), mapped, base, 0.5)
    with pytest.raises(IndexError, match="midpoint"):
        place_midpoints(state.mesh, midpoint, count - 1, state.points)
    with pytest.raises(IndexError, match="midpoint"):
        split_faces(state.mesh, midpoint, mapped)
    with pytest.raises(IndexError, match="home"):
        flip_edges(state.mesh._replace(home=state.mesh.home + 80), mapped, state.points, 1.0, 1)
