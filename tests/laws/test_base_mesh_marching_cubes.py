"""Marching cubes is manifold and closed whatever the signs, and the narrow band misses nothing it promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import BOX, ball, bumpy, hollow_ball, torus, two_balls

from ndf_core.base_mesh.cube_cases import EDGES, case_triangles
from ndf_core.base_mesh.lattice import Lattice
from ndf_core.base_mesh.marching_cubes import marching_cubes
from ndf_core.base_mesh.narrow_band import sample_near_level_set
from ndf_core.errors import BaseMeshError
from ndf_core.mesh import signed_volume, topology


def test_every_case_separates_inside_from_outside() -> None:
    table, counts = case_triangles()
    for case in range(256):
        crossed = {e for e, (a, b) in enumerate(EDGES) if (case >> a & 1) != (case >> b & 1)}
        assert set(table[case, : counts[case]].reshape(-1).tolist()) == crossed


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.95))
def test_manifold_and_closed_for_random_signs(seed: int, share: float) -> None:
    inside = np.random.default_rng(seed).random((8, 8, 8)) < share
    inside[4, 4, 4] = True

    def field(points: np.ndarray) -> np.ndarray:
        index = np.rint((points - BOX[0]) / (3 / 7)).astype(int)
        return np.where(inside[tuple(index.T)], -1.0, 1.0)

    band = sample_near_level_set(field, BOX, 7, None)
    for width in (1, 2):
        vertices, faces = marching_cubes(band, width)
        counts = topology(faces, len(vertices))
        assert counts.manifold and counts.closed
    vertices, faces = marching_cubes(band, 1)
    assert signed_volume(vertices, faces) > 0
    # The surface bounds exactly the corners inside: as many as a solid of dual cells would enclose by parity.
    lattice = band.lattice
    index = lattice.corner_index(band.corners)
    within = lattice.within(index)
    assert np.array_equal(band.values[within] < 0, inside[tuple((index[within] - 1).T)])


@pytest.mark.parametrize(
    ("field", "genus", "components", "lipschitz"),
    [(ball, 0, 1, 1.0), (torus, 1, 1, 1.0), (two_balls, 0, 2, 1.0), (hollow_ball, 0, 2, 1.0), (bumpy, 0, 1, 2.0)],
)
def test_known_topology_both_ways(field, genus: int, components: int, lipschitz: float) -> None:
    meshes = [
        marching_cubes(sample_near_level_set(field, BOX, 48, lipschitz)),
        marching_cubes(sample_near_level_set(field, BOX, 48, None)),
        marching_cubes(sample_near_level_set(field, BOX, 48, lipschitz, lambda p: np.abs(field(p)))),
    ]
    for vertices, faces in meshes:
        counts = topology(faces, len(vertices))
        assert (counts.genus, counts.components) == (genus, components)
        assert np.array_equal(vertices, meshes[0][0]) and np.array_equal(faces, meshes[0][1])


def test_vertices_approach_the_level_set_quadratically() -> None:
    errors = [
        np.abs(torus(marching_cubes(sample_near_level_set(torus, BOX, n, 1.0))[0])).max() for n in (32, 64, 128)
    ]
    assert errors[1] < errors[0] / 3 and errors[2] < errors[1] / 3


def test_vertices_around_a_corner_can_be_told_apart_when_stored() -> None:
    """Also on the finest grid, where the level set all but goes through one of its corners."""
    corner = BOX[0] + 3 * np.array([200, 256, 300]) / 512

    def speck(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - corner, axis=1) - 1e-7

    vertices, faces = marching_cubes(sample_near_level_set(speck, BOX, 512, 1.0))
    assert len(faces) == 8
    apart = np.linalg.norm(vertices[:, None] - vertices, axis=2) + 3 * np.eye(len(vertices))
    assert apart.min() > 4 * 3 / 65535


def test_bisection_finds_the_surface_of_an_occupancy() -> None:
    def occupancy(points: np.ndarray) -> np.ndarray:
        return np.where(torus(points) < 0, -1.0, 1.0)

    band = sample_near_level_set(occupancy, BOX, 64, None)
    step = 3 / 64
    for bisections in (0, 3):
        vertices, _ = marching_cubes(band, 1, occupancy, bisections)
        assert np.abs(torus(vertices)).max() <= 0.5 * step * 0.5**bisections * (1 + 1e-9)


def test_the_band_is_thin() -> None:
    asked = [0]

    def counting(points: np.ndarray) -> np.ndarray:
        asked[0] += len(points)
        return torus(points)

    sample_near_level_set(counting, BOX, 128, 1.0)
    assert asked[0] < 129**3 / 10


def test_no_small_part_is_missed_with_a_bound() -> None:
    def field(points: np.ndarray) -> np.ndarray:
        return np.minimum(ball(points, radius=0.5), ball(points, (1.2, 1.2, 1.2), 0.05))

    vertices, faces = marching_cubes(sample_near_level_set(field, BOX, 128, 1.0))
    assert topology(faces, len(vertices)).components == 2


def test_the_inside_is_cut_off_at_the_bounds() -> None:
    bounds = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]])

    def only_within(points: np.ndarray) -> np.ndarray:
        assert (points >= bounds[0] - 1e-12).all() and (points <= bounds[1] + 1e-12).all()
        return ball(points, radius=0.8)

    for lipschitz in (1.0, None):
        band = sample_near_level_set(only_within, bounds, 40, lipschitz)
        vertices, faces = marching_cubes(band)
        counts = topology(faces, len(vertices))
        assert counts.closed and counts.manifold and counts.euler_characteristic == 2
        assert signed_volume(vertices, faces) == pytest.approx(2 / 3 * np.pi * 0.8**3, rel=0.01)


def test_all_inside_gives_the_box() -> None:
    bounds = np.array([[0.0, 0.0, 0.0], [2.0, 1.0, 0.5]])
    for lipschitz in (1.0, None):
        band = sample_near_level_set(lambda p: np.full(len(p), -9.0), bounds, 32, lipschitz)
        vertices, faces = marching_cubes(band)
        assert signed_volume(vertices, faces) == pytest.approx(1.0, rel=0.01)


def test_nothing_inside_is_an_error_with_the_range() -> None:
    with pytest.raises(BaseMeshError, match=r"between \(-1.5, -1.5, -1.5\).*from .* to"):
        sample_near_level_set(lambda p: ball(p) + 5, BOX, 32, 1.0)


def test_a_field_that_is_not_a_number_is_an_error_with_the_place() -> None:
    with pytest.raises(BaseMeshError, match="not a number at .* first at"):
        sample_near_level_set(lambda p: np.where(p[:, 0] > 0, np.nan, ball(p)), BOX, 32, 1.0)
    with pytest.raises(BaseMeshError, match="values for"):
        sample_near_level_set(lambda p: ball(p)[:-1], BOX, 32, 1.0)


def test_keys_and_indices_are_inverse() -> None:
    lattice = Lattice.over(np.array([[0.0, 0, 0], [1.0, 2.0, 0.3]]), 20, 4)
    index = np.random.default_rng(0).integers(0, lattice.size + 1, size=(100, 3))
    assert np.array_equal(lattice.corner_index(lattice.corner_keys(index)), index)
    assert np.array_equal(lattice.positions(np.ones((1, 3))), [[0, 0, 0]])
    assert lattice.positions(lattice.inner[None] + 1)[0] == pytest.approx([1.0, 2.0, 0.3])
