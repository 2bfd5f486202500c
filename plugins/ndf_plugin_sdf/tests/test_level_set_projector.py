"""Laws of the projection onto level sets, and its distance from the true closest point."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from ndf_plugin_sdf.csg.tree import parse_tree
from ndf_plugin_sdf.tree_field import TreeField
from scipy.spatial import KDTree
from sdf_trees import BALL, SOLIDS, node

from ndf_core.errors import InputError
from ndf_core.surfaces.level_set_projector import LevelSetProjector
from ndf_core.surfaces.random_lines import sample_level_set


def field_of(tree: dict[str, Any]) -> TreeField:
    return TreeField(parse_tree(tree))


def near_surface(field: TreeField, count: int, noise: float, seed: int = 0) -> torch.Tensor:
    """Surface points, moved by `noise` times the size."""
    rng = np.random.default_rng(seed)
    points, _ = sample_level_set(field, count, rng)
    return torch.from_numpy(points + rng.normal(size=points.shape) * noise * field.bounds.longest_side)


@pytest.mark.parametrize("name", SOLIDS)
def test_projections_lie_on_the_surface(name: str) -> None:
    field = field_of(SOLIDS[name])
    answer = LevelSetProjector(field).project(near_surface(field, 2000, 0.02))
    assert answer.converged.double().mean() > 0.998
    assert float(field.values(answer.points[answer.converged]).abs().max()) < 1e-6 * field.bounds.longest_side
    assert answer.normals is not None
    np.testing.assert_allclose(answer.normals[answer.converged].norm(dim=1).numpy(), 1.0, rtol=1e-9)


@pytest.mark.parametrize("name", SOLIDS)
def test_points_on_the_surface_stay_and_projecting_twice_is_projecting_once(name: str) -> None:
    field = field_of(SOLIDS[name])
    projector, size = LevelSetProjector(field), field.bounds.longest_side
    surface = near_surface(field, 2000, 0.0)
    assert float((projector.project(surface).points - surface).norm(dim=1).max()) < 1e-8 * size
    once = projector.project(near_surface(field, 2000, 0.02))
    twice = projector.project(once.points[once.converged])
    assert bool(twice.converged.all())
    assert float((twice.points - once.points[once.converged]).norm(dim=1).max()) < 1e-6 * size


@pytest.mark.parametrize("name", SOLIDS)
def test_rows_are_independent(name: str) -> None:
    field = field_of(SOLIDS[name])
    projector, points = LevelSetProjector(field), near_surface(field, 600, 0.03)
    whole = projector.project(points)
    order = torch.from_numpy(np.random.default_rng(1).permutation(len(points)))
    parts = [projector.project(part) for part in points[order].split(37)]
    size = field.bounds.longest_side
    shuffled = torch.cat([part.points for part in parts])
    assert float((shuffled - whole.points[order]).norm(dim=1).max()) < 1e-9 * size
    assert bool((torch.cat([part.converged for part in parts]) == whole.converged[order]).all())


def test_rigid_motion_and_scale_move_the_projection() -> None:
    for name in ("blob", "bracket"):
        tree = SOLIDS[name]
        turn = node("rotate", child=tree, axis=[1, 2, 3], angle=33.0)
        matrix = torch.from_numpy(turn.matrix)  # pyright: ignore
        moved = {"type": "rotate", "child": tree, "axis": [1, 2, 3], "angle": 33.0}
        moved = {"type": "scale", "factor": 7.0, "child": {"type": "translate", "offset": [3, 2, 1], "child": moved}}
        points = near_surface(field_of(tree), 500, 0.01)
        there = (points @ matrix.T + torch.tensor([3.0, 2, 1])) * 7.0
        one, other = (
            LevelSetProjector(field_of(tree)).project(points),
            LevelSetProjector(field_of(moved)).project(there),
        )
        gap = ((one.points @ matrix.T + torch.tensor([3.0, 2, 1])) * 7.0 - other.points).norm(dim=1)
        # At edges a rounding error may decide which face comes first, and at the threshold whether to correct.
        assert float(gap.quantile(0.97)) < 1e-6
        assert float(gap.quantile(0.99)) < 7.0 * 2e-5 * 4.0


def test_dtype_is_kept_and_the_input_is_left_alone() -> None:
    projector = LevelSetProjector(field_of(BALL))
    for dtype in (torch.float32, torch.float64):
        points = torch.rand(50, 3, dtype=dtype)
        before = points.clone()
        answer = projector.project(points)
        assert answer.points.dtype == dtype
        assert answer.normals is not None
        assert answer.normals.dtype == dtype
        assert torch.equal(points, before)
        assert not answer.points.requires_grad


def test_it_works_whatever_the_gradient_mode() -> None:
    projector = LevelSetProjector(field_of(SOLIDS["blob"]))
    points = torch.rand(50, 3, dtype=torch.float64)
    expected = projector.project(points).points
    with torch.no_grad():
        assert torch.equal(projector.project(points).points, expected)
    with torch.inference_mode():
        assert torch.equal(projector.project(points * 1.0).points, expected)
    answer = projector.project(points.clone().requires_grad_(True)).points
    assert torch.equal(answer, expected)
    assert not answer.requires_grad


def test_no_points_and_bad_points() -> None:
    projector = LevelSetProjector(field_of(BALL))
    empty = projector.project(torch.zeros(0, 3, dtype=torch.float64))
    assert empty.points.shape == (0, 3)
    assert empty.converged.shape == (0,)
    for bad in (float("nan"), float("inf")):
        points = torch.zeros(4, 3, dtype=torch.float64)
        points[2, 1] = bad
        with pytest.raises(InputError, match="query point 2: a coordinate is not finite"):
            projector.project(points)


@pytest.mark.parametrize(
    "tree", [{"type": "sphere", "radius": 1}, {"type": "torus", "major_radius": 1, "minor_radius": 0.2}]
)
def test_centres_and_axes_have_no_gradient_and_converge_all_the_same(tree: dict[str, Any]) -> None:
    points = torch.tensor([[0.0, 0, 0], [0, 0, 0.5], [1.0, 0, 0]], dtype=torch.float64)
    field = field_of(tree)
    answer = LevelSetProjector(field).project(points)
    assert bool(answer.converged.all())
    assert float(field.values(answer.points).abs().max()) < 1e-9


def test_closest_point_of_exact_distances() -> None:
    """One Newton step of an exact distance is the closest point: sphere, torus and box have closed forms."""
    points = torch.from_numpy(np.random.default_rng(0).uniform(-1.5, 1.5, (3000, 3)))
    ball = LevelSetProjector(field_of({"type": "sphere", "radius": 1})).project(points)
    np.testing.assert_allclose(ball.points, points / points.norm(dim=1, keepdim=True), atol=1e-9)
    ring = LevelSetProjector(field_of({"type": "torus", "major_radius": 1, "minor_radius": 0.2})).project(points)
    core = points * torch.tensor([1.0, 1, 0]) / points[:, :2].norm(dim=1, keepdim=True)
    expected = core + 0.2 * (points - core) / (points - core).norm(dim=1, keepdim=True)
    inside = ((ring.points - expected).norm(dim=1) < 1e-8).double().mean()
    assert float(inside) > 0.999
    box = LevelSetProjector(field_of({"type": "box", "size": [2, 2, 2]})).project(points)
    outside = (points.abs() > 1).any(dim=1)
    np.testing.assert_allclose(box.points[outside], points.clamp(-1, 1)[outside], atol=1e-8)


@pytest.mark.parametrize("name", SOLIDS)
def test_projections_are_almost_the_closest_points(name: str) -> None:
    """Against the nearest of 60,000 samples: what a projection is farther away than that is its own fault.

    One hundredth of the size is more than a base mesh is off.
    """
    field = field_of(SOLIDS[name])
    size = field.bounds.longest_side
    points = near_surface(field, 1500, 0.01)
    samples, _ = sample_level_set(field, 60_000, np.random.default_rng(5))
    reference, _ = KDTree(samples).query(points.numpy())
    excess = {}
    for corrections in (0, 2):
        answer = LevelSetProjector(field, corrections).project(points)
        distance = (answer.points - points).norm(dim=1).numpy()[answer.converged.numpy()]
        excess[corrections] = np.maximum(distance - reference[answer.converged.numpy()], 0.0) / size
    assert np.quantile(excess[2], 0.99) < 1e-5
    # Inside a union the nearest surface may be that of another part than the field's.
    assert (excess[2] > 1e-3).mean() < 3e-3
    assert excess[2].mean() <= excess[0].mean()


def test_blades_sharper_than_a_right_angle_converge_on_their_edges() -> None:
    """Alternating projections onto two planes never arrive there; the step into both tangent planes does."""
    for slope in (1.0, 4.0, 20.0):
        wedge = {
            "type": "intersection",
            "children": [
                {"type": "box", "size": [2, 2, 2]},
                {"type": "plane", "normal": [1, slope, 0]},
                {"type": "plane", "normal": [1, -slope, 0]},
            ],
        }
        rng = np.random.default_rng(0)
        points = torch.from_numpy(rng.uniform([0.001, 0, -0.9], [0.2, 1e-4, 0.9], (500, 3)))
        answer = LevelSetProjector(field_of(wedge)).project(points)
        assert bool(answer.converged.all())
        np.testing.assert_allclose(answer.points[:, :2].numpy(), 0.0, atol=2e-3)


def test_what_is_outside_of_the_bounds_is_not_the_surface() -> None:
    from ndf_core.surfaces.box import Box

    field = TreeField(parse_tree({"type": "repeat", "child": BALL, "count": [3, 1, 1], "spacing": [3, 3, 3]}))
    field.bounds = Box(np.array([-1.5, -1.5, -1.5]), np.array([1.5, 1.5, 1.5]))
    points = torch.tensor([[1.3, 0, 0], [4.0, 0, 0]], dtype=torch.float64)
    assert LevelSetProjector(field).project(points).converged.tolist() == [True, False]


def test_points_far_away_and_units_do_not_matter() -> None:
    for scale, offset in ((1e-6, 0.0), (1e6, 0.0), (1.0, 1e6)):
        tree = {
            "type": "translate",
            "offset": [offset, 0, 0],
            "child": {"type": "scale", "factor": scale, "child": BALL},
        }
        field = field_of(tree)
        points = near_surface(field, 500, 0.02)
        answer = LevelSetProjector(field).project(points)
        assert bool(answer.converged.all())
        centre = torch.tensor(np.array([offset, 0.0, 0.0]) + scale * np.array(BALL["center"]))
        np.testing.assert_allclose(
            (answer.points - centre).norm(dim=1) / scale, 1.0, rtol=1e-8 if offset == 0 else 1e-6
        )
