"""What counts as outside: hollows are filled, floaters go, narrow gaps close."""

from __future__ import annotations

import numpy as np
import pytest
from ndf_plugin_nerf.isosurface import isosurface
from ndf_plugin_nerf.lattice import Nodes
from ndf_plugin_nerf.outer_field import OuterField
from ndf_plugin_nerf.outside import flooded, parts_of
from ndf_plugin_nerf.sampled import sample_all, sample_near
from nerf_shapes import THRESHOLD, ball, density, shell, union

from ndf_core.mesh import signed_volume, topology
from ndf_core.surfaces.box import Box

CUBE = Box(np.full(3, -1.5), np.full(3, 1.5))


def test_a_hollow_ball_has_one_surface() -> None:
    hollow = OuterField.of(density(shell(0.5, 1.0)), CUBE, THRESHOLD, 48, 0.05)
    vertices, faces = isosurface(hollow.nodes, hollow.values)
    counts = topology(faces, len(vertices))
    assert (counts.closed, counts.manifold, counts.components, counts.genus) == (True, True, 1, 0)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0, atol=2e-3)
    assert abs(signed_volume(vertices, faces) / (4 / 3 * np.pi) - 1) < 0.01


def test_floaters_go_and_equal_parts_stay() -> None:
    shape = union(ball((-0.7, 0, 0), 0.5), ball((0.7, 0, 0), 0.45), ball((0, 0, 1.2), 0.1))
    field = OuterField.of(density(shape), CUBE, THRESHOLD, 48, 0.05)
    vertices, faces = isosurface(field.nodes, field.values)
    assert topology(faces, len(vertices)).components == 2
    assert vertices[:, 2].max() < 0.6
    (remark,) = field.remarks
    assert (remark.kind, remark.count) == ("dropped_component", 1)
    assert remark.size is not None
    assert 0.1 < remark.size < 0.2  # the cube of the ball's volume
    everything = OuterField.of(density(shape), CUBE, THRESHOLD, 48, 0.0)
    assert topology(isosurface(everything.nodes, everything.values)[1], 10**6).components == 3
    assert everything.remarks == ()


def test_the_flood_keeps_out_of_narrow_gaps() -> None:
    empty = np.ones((20, 20, 20), dtype=bool)
    empty[4:16, 4:16, 4:16] = False
    empty[8:11, 8:11, 8:11] = True  # a chamber, and a corridor to it one node wide
    empty[9, 9, 11:16] = True
    assert flooded(empty)[9, 9, 9]
    closed = flooded(empty, clearance=1)
    assert not closed[9, 9, 9]
    outside = empty.copy()
    outside[4:16, 4:16, 4:16] = False
    outside[9, 9, 15] = True  # the mouth of the corridor
    np.testing.assert_array_equal(closed, outside)  # but for the corridor, outside is as before


def test_parts_come_from_the_largest_to_the_smallest() -> None:
    solid = np.zeros((12, 5, 5), dtype=bool)
    solid[0] = solid[4:7] = solid[9, :2] = True
    parts = parts_of(solid)
    assert parts.sizes.tolist() == [75, 25, 10]
    assert [int(parts.label[x, 0, 0]) for x in (5, 0, 9, 2)] == [1, 2, 3, 0]
    assert [parts.of_share(least) for least in (0.0, 0.2, 0.5)] == [3, 2, 1]


def test_sampling_near_the_surface_is_exact_there_and_cheaper() -> None:
    shape = density(union(ball((-0.6, 0, 0), 0.5), ball((0.65, 0.1, 0), 0.4)))
    nodes = Nodes.over(CUBE, 64)
    all_of, (near, asked) = sample_all(shape, nodes), sample_near(shape, nodes, THRESHOLD)
    assert asked < 0.4 * nodes.total
    np.testing.assert_array_equal(near >= THRESHOLD, all_of >= THRESHOLD)
    one, other = isosurface(nodes, THRESHOLD - near), isosurface(nodes, THRESHOLD - all_of)
    np.testing.assert_array_equal(one[0], other[0])


@pytest.mark.parametrize("count", [(3, 5, 7), (9, 3, 3)])
def test_whatever_the_signs_the_surface_is_closed_and_manifold(count: tuple[int, int, int]) -> None:
    values = np.random.default_rng(0).standard_normal(count).astype(np.float32)
    nodes = Nodes(CUBE, count)
    vertices, faces = isosurface(nodes, values)
    counts = topology(faces, len(vertices))
    assert counts.closed
    assert counts.manifold
    step = 3.0 / (min(count) - 1)
    assert np.abs(vertices).max() <= 1.5 + 1.01e-3 * step  # caps lie a thousandth of a cell beyond the bounds
