"""Copies by folding against the union of every copy."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ndf_plugin_sdf.csg.tree import parse_tree
from sdf_trees import PRIMITIVES, cloud, node, values

from ndf_core.errors import InputError

POINTS = cloud(0, 3000, 4.0)
_spacing = st.lists(st.floats(0.6, 2.0), min_size=3, max_size=3)


def every_copy(child: dict[str, Any], count: list[int], spacing: list[float], points: np.ndarray) -> np.ndarray:
    solid = parse_tree(child)
    copies = itertools.product(*map(range, count))
    return np.min([values(solid, points - np.multiply(copy, spacing)) for copy in copies], axis=0)


def every_turn(child: dict[str, Any], count: int, points: np.ndarray) -> np.ndarray:
    turned = [node("rotate", child=child, axis=[0, 0, 1], angle=360.0 * i / count) for i in range(count)]
    return np.min([values(copy, points) for copy in turned], axis=0)


@settings(max_examples=60, deadline=None)
@given(PRIMITIVES, st.tuples(*[st.integers(1, 4)] * 3).map(list), _spacing)
def test_repeat_is_the_union_of_the_copies(child: dict[str, Any], count: list[int], spacing: list[float]) -> None:
    folded = values(node("repeat", child=child, count=count, spacing=spacing), POINTS)
    union = every_copy(child, count, spacing, POINTS)
    # Children with exact distances: equal outside. Inside, overlapping copies may hide the deepest one.
    outside = union > 0
    np.testing.assert_allclose(folded[outside], union[outside], atol=1e-9)
    assert (folded[union < -1e-9] < 0).all()


@settings(max_examples=60, deadline=None)
@given(PRIMITIVES, st.integers(1, 12), st.floats(0.0, 3.0))
def test_repeat_around_is_the_union_of_the_copies(child: dict[str, Any], count: int, away: float) -> None:
    child = {"type": "translate", "child": child, "offset": [away, away / 3, 0.0]}
    folded = values(node("repeat_around", child=child, count=count), POINTS)
    union = every_turn(child, count, POINTS)
    outside = union > 0
    np.testing.assert_allclose(folded[outside], union[outside], atol=1e-9)
    assert (folded[union < -1e-9] < 0).all()


def test_a_bound_stays_a_bound_under_repetition() -> None:
    """|field| <= L * distance to the surface, where the child's field is no distance (a thin wedge)."""
    wedge = {
        "type": "intersection",
        "children": [
            {"type": "sphere", "radius": 0.7},
            {"type": "plane", "normal": [1, 4, 0]},
            {"type": "plane", "normal": [1, -4, 0]},
        ],
    }
    solid = node("repeat", child=wedge, count=[3, 3, 2], spacing=[0.9, 0.5, 1.2])
    rng = np.random.default_rng(0)
    points = rng.uniform([-1, -1, -1], [3, 2, 2.5], (200_000, 3))
    field = values(solid, points)
    surface = points[np.abs(field) < 0.02]
    surface = surface[rng.permutation(len(surface))[:20_000]]
    gap = np.abs(values(solid, surface))
    for batch in np.array_split(points[:400], 4):
        distance = np.linalg.norm(batch[:, None] - surface, axis=2)
        assert (np.abs(values(solid, batch))[:, None] <= distance + gap + 1e-9).all()


def test_many_copies_cost_few_evaluations() -> None:
    beads = node("repeat", child={"type": "sphere", "radius": 0.4}, count=[1000, 1000, 1], spacing=[1, 1, 1])
    assert beads.cost <= 4
    np.testing.assert_allclose(beads.bounds().upper, [999.4, 999.4, 0.4])
    np.testing.assert_allclose(values(beads, np.array([[500.0, 700.0, 2.0], [2000.0, 0, 0]])), [1.6, 1000.6])


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"child": {"type": "plane", "normal": [1, 1, 0]}}, "bounded"),
        ({"child": {"type": "sphere", "radius": 50}}, "wider spacing"),
    ],
)
def test_what_cannot_be_repeated_is_refused(fields: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        node("repeat", count=[100, 100, 100], spacing=[1, 1, 1], **fields)
    with pytest.raises(InputError, match="bounded|off the z axis"):
        node("repeat_around", count=1000, **fields)
