"""The base mesh of a field: right topology, every loss reported, nothing lost that is real."""

from __future__ import annotations

import numpy as np
import pytest
from solids import BOX, ball, bumpy, hollow_ball, mesh_of, torus, two_balls

from ndf_core.base_mesh.crumbs import drop_crumbs
from ndf_core.base_mesh.handles import cut_and_close, remove_small_handles
from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.base_mesh.loops import short_loops
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh
from ndf_core.mesh import signed_volume, topology

COARSE = LevelSetPolicy(resolution=64, max_resolution=64)


def kinds(mesh: BaseMesh) -> dict[str, int]:
    found: dict[str, int] = {}
    for remark in mesh.remarks:
        found[remark.kind] = found.get(remark.kind, 0) + remark.count
    return found


@pytest.mark.parametrize("lipschitz", [1.0, None])
def test_torus(lipschitz: float | None) -> None:
    mesh = LevelSetExtractor(torus, BOX, lipschitz=lipschitz, policy=COARSE).extract(500)
    counts = topology(mesh.faces, len(mesh.vertices))
    assert counts.genus == 1 and 480 <= counts.faces <= 500
    assert mesh.remarks == ()
    assert np.abs(torus(mesh.vertices)).max() < 0.02
    assert mesh.vertices.dtype == np.float64 and mesh.faces.dtype == np.int32
    again = LevelSetExtractor(torus, BOX, lipschitz=lipschitz, policy=COARSE).extract(500, seed=7)
    assert np.array_equal(again.vertices, mesh.vertices) and np.array_equal(again.faces, mesh.faces)


def test_cavities_are_kept() -> None:
    mesh = LevelSetExtractor(hollow_ball, BOX, lipschitz=1.0, policy=COARSE).extract(600)
    assert topology(mesh.faces, len(mesh.vertices)).components == 2
    assert signed_volume(mesh.vertices, mesh.faces) == pytest.approx(4 / 3 * np.pi * (1 - 0.6**3), rel=0.03)


def test_crumbs_and_tiny_cavities_are_left_out_and_reported() -> None:
    cell = 3 / 64

    def field(points: np.ndarray) -> np.ndarray:
        with_crumbs = np.minimum(ball(points, radius=0.8), ball(points, (1.1, 0, 0), 1.2 * cell))
        return np.maximum(with_crumbs, -ball(points, (0.1, 0.2, 0.3), 1.2 * cell))

    mesh = LevelSetExtractor(field, BOX, lipschitz=1.0, policy=COARSE).extract(400)
    assert topology(mesh.faces, len(mesh.vertices)).components == 1
    assert kinds(mesh) == {"dropped_component": 1, "filled_cavity": 1}
    for remark, place in zip(mesh.remarks, ((1.1, 0, 0), (0.1, 0.2, 0.3)), strict=True):
        assert remark.position == pytest.approx(place, abs=0.5 * cell)
        assert remark.size == pytest.approx(2.4 * cell * 3**0.5, rel=0.3)


def test_the_resolution_rises_where_the_topology_asks_for_it() -> None:
    """A gap of 1.6 coarse cells between two halves of a torus is bridged at half the resolution."""

    def field(points: np.ndarray) -> np.ndarray:
        return np.maximum(torus(points), 0.038 - np.abs(points[:, 1]))

    one = LevelSetExtractor(field, BOX, lipschitz=1.0, policy=COARSE).dense()
    assert [remark.kind for remark in one[2]] == ["topology_not_settled"]
    finer = LevelSetPolicy(resolution=64, max_resolution=128)
    vertices, faces, remarks = LevelSetExtractor(field, BOX, lipschitz=1.0, policy=finer).dense()
    counts = topology(faces, len(vertices))
    assert (counts.components, counts.genus) == (2, 0) and remarks == []


def test_a_level_set_that_reaches_the_bounds_is_capped_and_reported() -> None:
    bounds = np.array([[-1.5, -1.5, 0.0], [1.5, 1.5, 1.5]])
    mesh = LevelSetExtractor(ball, bounds, lipschitz=1.0, policy=COARSE).extract(300)
    assert kinds(mesh) == {"capped": 1} and "-z" in mesh.remarks[0].message
    assert mesh.remarks[0].position == pytest.approx((0, 0, 0), abs=0.1)
    assert signed_volume(mesh.vertices, mesh.faces) == pytest.approx(2 / 3 * np.pi, rel=0.05)


def test_too_few_faces_is_said() -> None:
    mesh = LevelSetExtractor(two_balls, BOX, lipschitz=1.0, policy=COARSE).extract(4)
    assert len(mesh.faces) >= 8
    assert kinds(mesh) == {"faces_not_reached": len(mesh.faces)}


@pytest.mark.parametrize("bounds", [[[0, 0, 0], [1, 0, 1]], [[0, 0, 0], [1, -1, 1]], [[0, 0, 0], [1, 1, np.inf]]])
def test_bad_bounds_are_refused(bounds: list[list[float]]) -> None:
    with pytest.raises(BaseMeshError, match="bounds"):
        LevelSetExtractor(ball, np.array(bounds, dtype=np.float64))


def _with_thin_handles(points: np.ndarray) -> np.ndarray:
    """A ball with a thin handle at the top and a narrow tunnel along x, off the centre."""
    handle = torus(points[:, [0, 2, 1]] - [0.0, 0.9, 0.0], 0.25, 0.05)
    tunnel = np.hypot(points[:, 1] - 0.3, points[:, 2] + 0.2) - 0.08
    return np.maximum(np.minimum(ball(points, radius=0.9), handle), -tunnel)


def test_handles_are_cut_and_tunnels_filled_below_the_limit_only() -> None:
    vertices, faces = mesh_of(_with_thin_handles, 72)
    assert topology(faces, len(vertices)).genus == 2
    for limit, genus, expected in (
        (0.1, 2, []),
        (0.42, 1, ["cut_handle"]),
        (0.7, 0, ["cut_handle", "filled_tunnel"]),
    ):
        points, corners, remarks = remove_small_handles(vertices, faces, limit)
        counts = topology(corners, len(points))
        assert counts.manifold and counts.closed and counts.components == 1
        assert counts.genus == genus
        assert sorted(remark.kind for remark in remarks) == expected
    for remark in remarks:
        assert remark.position is not None
        x, y, z = remark.position
        place = (np.hypot(np.hypot(x, z - 0.9) - 0.25, y), np.hypot(y - 0.3, z + 0.2))
        assert place[remark.kind == "filled_tunnel"] < 0.05


def test_short_loops_are_loops_of_edges_that_separate_nothing() -> None:
    vertices, faces = mesh_of(torus, 24)
    (loop,) = short_loops(vertices, faces, 2.5)
    path = np.array(loop.vertices)
    edges = np.stack([path, np.roll(path, -1)], axis=1)
    known = {frozenset(edge) for edge in faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()}
    assert all(frozenset(edge) in known for edge in edges.tolist()) and len(set(loop.vertices)) == len(path)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).sum()
    assert loop.length == pytest.approx(length)
    # Round the tube, whose circumference is 0.6 pi, and not round the hole.
    assert 0.6 * np.pi * 0.9 < loop.length < 0.6 * np.pi * 1.25
    points, corners = cut_and_close(vertices, faces, loop.vertices)
    counts = topology(corners, len(points))
    assert (counts.genus, counts.components, counts.manifold) == (0, 1, True)


def test_a_sphere_has_no_loop() -> None:
    assert short_loops(*mesh_of(bumpy, 16), 100.0) == []


def test_the_largest_component_is_never_a_crumb() -> None:
    vertices, faces = mesh_of(two_balls, 24)
    points, corners, remarks = drop_crumbs(vertices, faces, 1e9)
    assert topology(corners, len(points)).components == 1
    assert [remark.kind for remark in remarks] == ["dropped_component"]
    assert points[:, 0].max() < 0


def test_many_crumbs_share_a_remark() -> None:
    def field(points: np.ndarray) -> np.ndarray:
        cell = points - np.rint(points * 4) / 4
        return np.minimum(
            ball(points, radius=0.4), np.where(points[:, 2] > 1, np.linalg.norm(cell, axis=1), 9) - 0.07
        )

    _, _, remarks = drop_crumbs(*mesh_of(field, 64), 0.5)
    assert len(remarks) == 9 and remarks[-1].count > 100 and "times more" in remarks[-1].message


def test_points_near_the_level_set_show_parts_that_a_coarse_grid_misses() -> None:
    def field(points: np.ndarray) -> np.ndarray:
        """An occupancy: a ball, and a speck of a seventieth of its size."""
        balls = [
            np.linalg.norm(points - center, axis=1) < radius
            for center, radius in (([0, 0, 0], 1.0), ([1.6, 0.3, 0.2], 0.03))
        ]
        return np.where(balls[0] | balls[1], -1.0, 1.0)

    bounds = np.array([[-1.2, -1.2, -1.2], [2.0, 1.2, 1.2]])
    policy = LevelSetPolicy(resolution=128, max_resolution=128, min_component=1.0)
    near = np.array([[1.0, 0.0, 0.0], [1.63, 0.3, 0.2]])
    for points, components in ((None, 1), (near, 2)):
        vertices, faces, _ = LevelSetExtractor(field, bounds, near=points, policy=policy).dense()
        assert topology(faces, len(vertices)).components == components
