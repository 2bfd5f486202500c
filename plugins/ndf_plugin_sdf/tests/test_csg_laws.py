"""Laws of whole trees: bounds, Lipschitz constants, and the algebra of the operators."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ndf_plugin_sdf.csg.tree import parse_tree
from sdf_trees import BALL, BLOB, BRACKET, SOLIDS, TREES, cloud, gradients, node, values

from ndf_core.surfaces.box import Box

POINTS = cloud(0, 4000, 3.0)
thoroughly = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def contains(box: Box, points: np.ndarray) -> np.ndarray:
    return ((points >= box.lower - 1e-9) & (points <= box.upper + 1e-9)).all(axis=1)


@thoroughly
@given(TREES, st.floats(0.0, 0.5))
def test_the_box_holds_the_sublevel_set(tree: dict[str, Any], level: float) -> None:
    solid = parse_tree(tree)
    low = values(solid, POINTS) <= level
    assert contains(solid.bounds(level), POINTS[low]).all()


@thoroughly
@given(TREES)
def test_no_pair_of_points_beats_the_lipschitz_bound(tree: dict[str, Any]) -> None:
    solid = parse_tree(tree)
    bound = solid.lipschitz(Box(np.full(3, -3.0), np.full(3, 3.0)))
    near = POINTS + 1e-3 * cloud(1, len(POINTS), 1.0)
    near = np.clip(near, -3.0, 3.0)
    for other in (near, np.roll(POINTS, 1, axis=0)):
        rise = np.abs(values(solid, POINTS) - values(solid, other))
        assert (rise <= bound * np.linalg.norm(POINTS - other, axis=1) * (1 + 1e-9) + 1e-12).all()


@thoroughly
@given(TREES)
def test_gradients_are_finite_and_are_derivatives(tree: dict[str, Any]) -> None:
    solid = parse_tree(tree)
    points = np.concatenate([POINTS[:500], np.zeros((1, 3))])
    gradient = gradients(solid, points)
    assert np.isfinite(gradient).all()
    step = 1e-6
    moves = np.eye(3) * step
    sides = np.stack([[values(solid, points + s * m) for m in moves] for s in (1, -1)])
    middle = values(solid, points)
    one_sided = np.abs((sides[0] + sides[1] - 2 * middle) / step).max(axis=0)
    smooth = one_sided < 1e-3  # no edge within the step
    numeric = ((sides[0] - sides[1]) / (2 * step)).T
    np.testing.assert_allclose(gradient[smooth], numeric[smooth], atol=2e-3)


@pytest.mark.parametrize("kind", ["union", "intersection", "smooth_union", "smooth_intersection"])
def test_order_of_children_does_not_matter(kind: str) -> None:
    children = [BALL, {"type": "box", "size": [1, 2, 1]}, {"type": "torus", "major_radius": 1, "minor_radius": 0.3}]
    extra = {"radius": 0.4} if kind.startswith("smooth") else {}
    one = values(node(kind, children=children, **extra), POINTS)
    np.testing.assert_allclose(one, values(node(kind, children=children[::-1], **extra), POINTS), atol=1e-12)


def test_difference_is_intersection_with_the_complement() -> None:
    box = {"type": "box", "size": [1, 2, 1]}
    expected = np.maximum(values(parse_tree(BALL), POINTS), -values(parse_tree(box), POINTS))
    np.testing.assert_array_equal(values(node("difference", children=[BALL, box]), POINTS), expected)


def test_smooth_difference_is_smooth_intersection_with_the_complement() -> None:
    """The complement of a half space is the half space with the opposite normal."""
    plane = {"type": "plane", "normal": [1, 1, 0], "offset": 0.1}
    complement = {"type": "plane", "normal": [-1, -1, 0], "offset": -0.1}
    one = node("smooth_difference", children=[BALL, plane], radius=0.3)
    other = node("smooth_intersection", children=[BALL, complement], radius=0.3)
    np.testing.assert_allclose(values(one, POINTS), values(other, POINTS), atol=1e-12)


@pytest.mark.parametrize("kind", ["union", "intersection", "difference"])
def test_smooth_forms_tend_to_the_sharp_ones(kind: str) -> None:
    children = [BLOB, BALL, {"type": "box", "size": [1, 2, 1]}]
    sharp = values(node(kind, children=children), POINTS)
    for radius in (0.3, 0.03, 0.003):
        smooth = values(node(f"smooth_{kind}", children=children, radius=radius), POINTS)
        assert np.abs(smooth - sharp).max() <= radius * (1 - 3**-0.5) + 1e-12


def test_idempotence() -> None:
    same = values(parse_tree(BRACKET), POINTS)
    for kind in ("union", "intersection"):
        np.testing.assert_array_equal(values(node(kind, children=[BRACKET, BRACKET]), POINTS), same)


@pytest.mark.parametrize("name", SOLIDS)
def test_placements_move_the_field(name: str) -> None:
    tree, points = SOLIDS[name], POINTS[:1000]
    field = values(parse_tree(tree), points)
    moved = node("translate", child=tree, offset=[1, -2, 0.5])
    np.testing.assert_allclose(values(moved, points + np.array([1, -2, 0.5])), field, atol=1e-12)
    turn = node("rotate", child=tree, axis=[1, 2, 3], angle=40.0)
    matrix = turn.matrix  # pyright: ignore
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(values(turn, points @ matrix.T), field, atol=1e-12)
    larger = node("scale", child=tree, factor=2.5)
    np.testing.assert_allclose(values(larger, points * 2.5), field * 2.5, atol=1e-12)
    flip = np.array([1.0, -1.0, 1.0])
    doubled = node("mirror", child=tree, axis="y", offset=0.5)
    image = points * flip + [0, 1, 0]
    np.testing.assert_allclose(
        values(doubled, points), np.minimum(field, values(parse_tree(tree), image)), atol=1e-12
    )


def test_rotation_is_counter_clockwise_and_euler_angles_turn_about_x_then_y_then_z() -> None:
    point = {"type": "sphere", "radius": 0.01, "center": [1, 0, 0]}
    quarter = node("rotate", child=point, axis=[0, 0, 5], angle=90)
    np.testing.assert_allclose(values(quarter, np.array([[0.0, 1.0, 0.0]])), -0.01)
    about_y = node("rotate", child=point, euler=[0, np.pi / 2, np.pi / 2], unit="radians")
    np.testing.assert_allclose(values(about_y, np.array([[0.0, 0.0, -1.0]])), -0.01)  # x to -z, which z keeps
    about_x = node("rotate", child={**point, "center": [0, 1, 0]}, euler=[90, 90, 0])
    np.testing.assert_allclose(values(about_x, np.array([[1.0, 0.0, 0.0]])), -0.01)  # y to z to x


def test_scaling_each_axis_keeps_the_bound_and_moves_the_surface() -> None:
    squashed = node("scale", child={"type": "sphere", "radius": 1.0}, factor=[0.1, 1.0, 0.5])
    assert np.linalg.norm(gradients(squashed, POINTS), axis=1).max() <= 1.0 + 1e-9
    directions = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    np.testing.assert_allclose(values(squashed, directions * [0.1, 1.0, 0.5]), 0.0, atol=1e-12)
    np.testing.assert_allclose(squashed.bounds(0.05).upper, [0.15, 1.5, 0.75])


def test_quarter_turns_keep_boxes_tight() -> None:
    box = node("rotate", child={"type": "box", "size": [2, 4, 6]}, axis=[0, 0, 1], angle=90).bounds()
    np.testing.assert_allclose(box.upper, [2, 1, 3], atol=1e-12)
    half_space = node("rotate", child={"type": "plane", "normal": [0, 0, 1], "offset": 2}, axis=[1, 0, 0], angle=-90)
    np.testing.assert_allclose(half_space.bounds().upper[1], 2.0)


def test_round_shell_ripple() -> None:
    field = values(parse_tree(BRACKET), POINTS)
    np.testing.assert_allclose(values(node("round", child=BRACKET, radius=0.1), POINTS), field - 0.1)
    np.testing.assert_allclose(values(node("shell", child=BRACKET, thickness=0.1), POINTS), np.abs(field) - 0.05)
    waves = np.sin(POINTS * 2 * np.pi / 0.5).prod(axis=1)
    rippled = values(node("ripple", child=BRACKET, amplitude=0.05, wavelength=0.5), POINTS)
    np.testing.assert_allclose(rippled, field - 0.05 * waves, atol=1e-12)


def test_twist_turns_each_height_by_its_angle() -> None:
    box = {"type": "box", "size": [2, 1, 4]}
    twisted = values(node("twist", child=box, rate=30.0), POINTS)
    for height in (-1.0, 0.0, 1.5):
        level = POINTS * [1, 1, 0] + [0, 0, height]
        turned = node("rotate", child=box, axis=[0, 0, 1], angle=30.0 * height)
        np.testing.assert_allclose(
            values(node("twist", child=box, rate=30.0), level), values(turned, level), atol=1e-12
        )
    still = node("twist", child=box, rate=0.0)
    np.testing.assert_array_equal(values(still, POINTS), values(parse_tree(box), POINTS))
    assert (twisted != values(parse_tree(box), POINTS)).any()
