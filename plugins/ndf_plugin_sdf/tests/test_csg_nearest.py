"""Solids that are left out because they cannot matter: the field stays the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ndf_plugin_sdf.csg import nearest
from ndf_plugin_sdf.csg.combine import Union
from ndf_plugin_sdf.csg.tree import parse_tree
from sdf_trees import BALL, PRIMITIVES, cloud, gradients, node, values

POINTS = cloud(0, 2000, 2.0)
BEADS = {
    "type": "repeat_around",
    "count": 12,
    "child": {
        "type": "translate",
        "offset": [1.1, 0, 0.2],
        "child": {"type": "ellipsoid", "radii": [0.2, 0.1, 0.15]},
    },
}


def everywhere(tree: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """The field in batches so small that every solid is evaluated."""
    solid = parse_tree(tree)
    return np.concatenate([values(solid, part) for part in np.array_split(points, len(points) // 200)])


def decorated(kind: str, others: list[dict[str, Any]], radius: float) -> dict[str, Any]:
    """A ball and costly others, as one solid."""
    costly = [{"type": "mirror", "axis": "x", "child": other} for other in others]
    smooth = {"radius": radius} if kind.startswith("smooth") else {}
    return {"type": kind, "children": [BALL, *costly], **smooth}


KINDS = ["union", "difference", "smooth_union", "smooth_difference"]


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(PRIMITIVES, min_size=1, max_size=4), st.floats(0.02, 0.6))
def test_leaving_solids_out_changes_nothing(kind: str, others: list[dict[str, Any]], radius: float) -> None:
    tree = decorated(kind, others, radius)
    np.testing.assert_allclose(values(parse_tree(tree), POINTS), everywhere(tree, POINTS), atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_too(kind: str) -> None:
    tree = parse_tree(decorated(kind, [BEADS], 0.1))
    whole = gradients(tree, POINTS)
    parts = np.concatenate([gradients(tree, part) for part in np.array_split(POINTS, 20)])
    np.testing.assert_allclose(whole, parts, atol=1e-10)


def test_it_does_leave_them_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Near the ball, and not near the ring of beads, few points need the beads."""
    tree = node("union", children=[BALL, BEADS])
    assert isinstance(tree, Union)
    seen: list[int] = []
    original = nearest._near

    def counting(*arguments: Any) -> Any:
        rows = original(*arguments)
        seen.append(len(rows) if rows is not None else len(POINTS))
        return rows

    monkeypatch.setattr(nearest, "_near", counting)
    directions = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    values(tree, directions * 1.01 + np.array(BALL["center"]))
    assert 0 < seen[0] < 0.5 * len(POINTS)
