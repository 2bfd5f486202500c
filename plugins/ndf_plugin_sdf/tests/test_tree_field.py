"""Bounds of trees: tight, finite, or a clear error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from ndf_plugin_sdf.csg.tree import parse_tree
from ndf_plugin_sdf.tree_field import TreeField
from sdf_trees import BALL, SOLIDS, TREES, cloud, node, values

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box

POINTS = cloud(0, 20_000, 3.0)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(TREES)
def test_tight_bounds_hold_the_whole_solid(tree: dict[str, Any]) -> None:
    solid = parse_tree(tree)
    inside = POINTS[values(solid, POINTS) <= 0]
    try:
        box = TreeField(solid).bounds
    except InputError as error:
        assert "empty" in str(error)
        assert not len(inside)
        return
    assert (inside >= box.lower).all()
    assert (inside <= box.upper).all()


def test_bounds_are_tight_where_intervals_are_not() -> None:
    turned = node("rotate", child={"type": "sphere", "radius": 1}, axis=[1, 1, 1], angle=30.0)
    box = TreeField(turned).bounds
    np.testing.assert_allclose(box.upper, 1.0, atol=0.1)
    assert turned.bounds().upper.max() > 1.2
    cut = {
        "type": "difference",
        "children": [{"type": "box", "size": [4, 4, 4]}, {"type": "plane", "normal": [-1, 0, 0]}],
    }
    assert TreeField(parse_tree(cut)).bounds.upper[0] < 0.2


def test_unbounded_and_empty_solids_are_refused() -> None:
    below, above = {"type": "plane", "normal": [0, 0, 1]}, {"type": "plane", "normal": [0, 0, -1], "offset": 1}
    slab = {"type": "intersection", "children": [below, above]}
    with pytest.raises(
        InputError, match=r"unbounded along x and y; intersect its planes with a box, or give --bounds"
    ):
        TreeField(parse_tree(slab))
    apart = {"type": "intersection", "children": [BALL, {**BALL, "center": [5, 0, 0]}]}
    with pytest.raises(InputError, match="empty"):
        TreeField(parse_tree(apart))
    swallowed = {"type": "difference", "children": [BALL, {**BALL, "radius": 2}]}
    with pytest.raises(InputError, match="empty"):
        TreeField(parse_tree(swallowed))


def test_given_bounds_make_an_unbounded_tree_finite() -> None:
    sides = [[1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0], [0, 1, 1], [0, 1, -1], [0, -1, 1], [0, -1, -1]]
    planes = [{"type": "plane", "normal": n, "offset": 1.0} for n in sides]
    solid = parse_tree({"type": "intersection", "children": planes})
    field = TreeField(solid, Box(np.full(3, -3.0), np.full(3, 3.0)))
    assert field.bounds.longest_side < 4


def test_memory_is_bounded_by_blocks() -> None:
    costly = node("repeat", child={"type": "sphere", "radius": 1}, count=[5, 5, 5], spacing=[0.6, 0.6, 0.6])
    field = TreeField(costly)
    assert field.block * costly.cost <= 1 << 23
    field.block = 1000
    points = torch.from_numpy(cloud(1, 3007, 2.0))
    np.testing.assert_array_equal(field.values(points)[-5:], field.values(points[-5:]))
    one, other = field.values_and_gradients(points)[0], field.values(points)
    np.testing.assert_allclose(one, other, atol=1e-15)


@pytest.mark.parametrize("name", SOLIDS)
def test_lipschitz_bound_holds_to_the_surface(name: str) -> None:
    """|phi(x)| <= L * distance to any zero: what the narrow band of the base mesh relies on."""
    field = TreeField(parse_tree(SOLIDS[name]))
    span = field.bounds.upper - field.bounds.lower
    points = field.bounds.lower + np.random.default_rng(0).random((4000, 3)) * span
    phi = field.values(torch.from_numpy(points)).numpy()
    sign_pairs = [(i, j) for i, j in zip(range(2000), range(2000, 4000), strict=True) if (phi[i] < 0) != (phi[j] < 0)]
    for i, j in sign_pairs:  # a zero lies between them, so both are nearer to it than they are to each other
        assert abs(phi[i]) + abs(phi[j]) <= field.lipschitz * np.linalg.norm(points[i] - points[j]) * (1 + 1e-9)
