"""The smooth minimum: its definition, its closed form for two fields, and the fillet that it makes."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from ndf_plugin_sdf.csg.smooth import smooth_minimum
from sdf_trees import node, values

RNG = np.random.default_rng(0)


def fields(count: int, spread: float) -> torch.Tensor:
    return torch.from_numpy(RNG.normal(size=(count, 500)) * spread)


@settings(max_examples=60, deadline=None)
@given(st.integers(2, 40), st.floats(0.01, 10), st.floats(0.01, 10))
def test_it_solves_its_equation(count: int, radius: float, spread: float) -> None:
    given_fields = fields(count, spread)
    t = smooth_minimum(given_fields, radius) + radius
    total = (t - given_fields).clamp_min(0).square().sum(dim=0)
    np.testing.assert_allclose(total.numpy(), radius**2, rtol=1e-9)


def test_two_fields_in_closed_form_agree_with_the_general_way() -> None:
    two = fields(2, 0.5)
    far = torch.full((1, 500), 100.0, dtype=torch.float64)
    np.testing.assert_allclose(smooth_minimum(two, 0.7), smooth_minimum(torch.cat([two, far]), 0.7), atol=1e-12)


def test_gradient_is_a_convex_combination() -> None:
    for count in (2, 3, 9):
        variable = fields(count, 0.5).requires_grad_(True)
        (weights,) = torch.autograd.grad(smooth_minimum(variable, 0.7).sum(), variable)
        assert float(weights.min()) >= 0.0
        np.testing.assert_allclose(weights.sum(dim=0).numpy(), 1.0, rtol=1e-9)
        step = torch.from_numpy(RNG.normal(size=(count, 500))) * 1e-6
        rise = smooth_minimum(variable + step, 0.7) - smooth_minimum(variable - step, 0.7)
        np.testing.assert_allclose(rise.detach() / 2, (weights * step).sum(dim=0), atol=1e-11)


def test_a_field_out_of_reach_changes_nothing() -> None:
    one = fields(1, 1.0)
    np.testing.assert_allclose(smooth_minimum(torch.cat([one, one + 0.5, one + 0.9]), 0.5), one[0], atol=1e-12)


def test_right_angles_get_a_circular_fillet() -> None:
    """The surface of two orthogonal half spaces is, in the crease, the circle about (r, r)."""
    planes = [{"type": "plane", "normal": [1, 0, 0]}, {"type": "plane", "normal": [0, 1, 0]}]
    union = node("smooth_union", children=planes, radius=0.5)
    angle = np.linspace(np.pi, 1.5 * np.pi, 50)
    arc = np.stack([0.5 + 0.5 * np.cos(angle), 0.5 + 0.5 * np.sin(angle), np.full(50, 7.0)], axis=1)
    np.testing.assert_allclose(values(union, arc), 0.0, atol=1e-12)


def test_the_box_grows_with_the_blend() -> None:
    """Where equal fields meet, the blended one lies lower: two balls in one place are a larger ball."""
    ball = {"type": "sphere", "radius": 1.0}
    twice = node("smooth_union", children=[ball, ball], radius=0.5)
    reach = 1.0 + 0.5 * (1.0 - 0.5**0.5)
    np.testing.assert_allclose(values(twice, np.array([[reach, 0, 0]])), 0.0, atol=1e-12)
    np.testing.assert_allclose(twice.bounds().upper, reach)


def test_the_answer_for_a_column_does_not_depend_on_the_others() -> None:
    many = fields(5, 0.5)
    alone = torch.cat([smooth_minimum(many[:, i : i + 1], 0.7) for i in range(500)])
    # But for rounding: torch sums one column in another order than many.
    np.testing.assert_allclose(smooth_minimum(many, 0.7).numpy(), alone.numpy(), atol=1e-14, rtol=0)
