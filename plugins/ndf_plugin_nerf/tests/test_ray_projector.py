"""Laws of the projection along given directions, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from ndf_plugin_nerf.outer_field import OuterField
from ndf_plugin_nerf.ray_projector import TOLERANCE, RayProjector
from nerf_shapes import THRESHOLD, ball, density, shell, union
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box

CUBE = Box(np.full(3, -1.5), np.full(3, 1.5))


def projector(distance, reach: float = 0.4, resolution: int = 48, least: float = 0.05) -> RayProjector:
    shape = density(distance)
    return RayProjector(shape, OuterField.of(shape, CUBE, THRESHOLD, resolution, least), reach)


def around_unit_sphere(count: int, spread: float, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Points near the unit sphere, and directions within 25 degrees of outwards."""
    rng = np.random.default_rng(seed)
    outward = rng.standard_normal((count, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    tilted = outward + 0.45 * rng.uniform(-1, 1, (count, 3)) / 3**0.5
    tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
    return torch.from_numpy(outward * (1 + rng.uniform(-spread, spread, (count, 1)))), torch.from_numpy(tilted)


def nearest_on_unit_sphere(points: Array, directions: Array) -> Array:
    """The root of |p + t d| = 1 with the smallest |t|."""
    along = (points * directions).sum(1)
    root = np.sqrt(along**2 - (points**2).sum(1) + 1)
    ends = np.stack([-along - root, -along + root])
    return points + ends[np.abs(ends).argmin(axis=0), np.arange(len(points))][:, None] * directions


@pytest.mark.parametrize("shape", [ball(), shell(0.55, 1.0)], ids=["ball", "hollow"])
def test_it_finds_the_nearest_crossing_of_the_line_with_the_outer_surface(shape) -> None:
    points, directions = around_unit_sphere(2000, 0.2, 0)
    found = projector(shape).project(points, directions)
    assert bool(found.converged.all())
    expected = nearest_on_unit_sphere(points.numpy(), directions.numpy())
    # The tolerance is along the ray, of a box with a side of 3.
    np.testing.assert_allclose(found.points.numpy(), expected, atol=4 * TOLERANCE * 3)
    assert found.normals is not None
    assert float((found.normals * torch.from_numpy(expected)).sum(1).min()) > 0.99


def test_the_inner_side_of_a_wall_is_no_surface() -> None:
    inside = torch.tensor([[0.6, 0.0, 0.0], [0.0, 0.5, 0.0]], dtype=torch.float64)
    found = projector(shell(0.55, 1.0), reach=0.6).project(inside, inside / inside.norm(dim=1, keepdim=True))
    assert bool(found.converged.all())
    np.testing.assert_allclose(found.points.norm(dim=1).numpy(), 1.0, atol=1e-4)


def test_projecting_twice_is_projecting_once() -> None:
    points, directions = around_unit_sphere(500, 0.2, 1)
    plane = projector(ball())
    once = plane.project(points, directions).points
    torch.testing.assert_close(plane.project(once, directions).points, once, rtol=0, atol=2 * TOLERANCE * 3)


def test_rows_do_not_depend_on_each_other_and_the_query_stays() -> None:
    points, directions = around_unit_sphere(300, 0.3, 2)
    before = points.clone(), directions.clone()
    plane = projector(ball())
    whole = plane.project(points, directions)
    for rows in (slice(0, 1), slice(100, 107), slice(299, 300)):
        part = plane.project(points[rows], directions[rows])
        torch.testing.assert_close(part.points, whole.points[rows], rtol=0, atol=1e-12)
    torch.testing.assert_close((points, directions), before, rtol=0, atol=0)
    single = plane.project(points.float(), directions.float())
    assert single.points.dtype == torch.float32
    assert plane.project(points[:0], directions[:0]).points.shape == (0, 3)


def test_rays_end_at_their_reach() -> None:
    axis = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    short = projector(ball(), reach=0.2)
    for height, expected in ((1.15, True), (1.3, False), (0.85, True), (0.7, False)):
        assert bool(short.project(height * axis, axis).converged[0]) is expected
    beside = torch.tensor([[1.2, 0.0, 0.0]], dtype=torch.float64)
    missed = projector(ball()).project(beside, axis)
    assert not bool(missed.converged[0])
    torch.testing.assert_close(missed.points, beside)


def test_a_floater_that_was_left_out_is_not_hit() -> None:
    shape = union(ball((0.0, 0.0, 0.0), 0.8), ball((0.0, 0.0, 1.2), 0.1))
    above = torch.tensor([[0.0, 0.0, 1.22]], dtype=torch.float64)
    axis = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    height = {
        least: float(projector(shape, reach=0.6, least=least).project(above, axis).points[0, 2])
        for least in (0.0, 0.05)
    }
    assert height[0.0] == pytest.approx(1.3, abs=1e-4)
    assert height[0.05] == pytest.approx(0.8, abs=1e-4)


def test_of_two_walls_the_one_that_faces_the_same_way_is_found() -> None:
    shape = union(ball((0.0, 0.0, -0.8), 0.6), ball((0.0, 0.0, 0.8), 0.6))  # at z = -0.2 and 0.2
    between = torch.tensor([[0.0, 0.0, 0.1], [0.0, 0.0, 0.1]], dtype=torch.float64)
    up_and_down = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], dtype=torch.float64)
    found = projector(shape).project(between, up_and_down)
    np.testing.assert_allclose(found.points[:, 2].numpy(), [-0.2, 0.2], atol=1e-4)
    assert found.normals is not None
    assert bool(((found.normals * up_and_down).sum(1) > 0.99).all())


def test_what_the_box_cuts_has_a_flat_cap() -> None:
    shape, box = density(ball()), Box(np.array([-1.5, -1.5, -0.3]), np.array([1.5, 1.5, 1.5]))
    plane = RayProjector(shape, OuterField.of(shape, box, THRESHOLD, 48, 0.05), 0.4)
    down = torch.tensor([[0.1, 0.0, -1.0]], dtype=torch.float64).expand(3, 3)
    near = torch.tensor([[0.0, 0.2, -0.2], [0.3, 0.1, -0.5], [0.0, 0.0, -0.3]], dtype=torch.float64)
    found = plane.project(near, down)
    assert bool(found.converged.all())
    np.testing.assert_allclose(found.points[:, 2].numpy(), -0.3, atol=1e-4)
    assert found.normals is not None
    assert float(found.normals[:, 2].max()) < -0.95


def test_directions_need_no_unit_length_but_one() -> None:
    points, directions = around_unit_sphere(50, 0.2, 3)
    plane = projector(ball())
    one, other = (plane.project(points, scale * directions).points for scale in (1.0, 7.0))
    torch.testing.assert_close(one, other, rtol=0, atol=1e-12)
    nowhere = plane.project(points, torch.zeros_like(directions))
    assert not bool(nowhere.converged.any())
    assert bool(nowhere.points.isfinite().all())


def test_bad_queries_are_errors() -> None:
    points, directions = around_unit_sphere(4, 0.1, 4)
    plane = projector(ball())
    with pytest.raises(InputError, match="needs one for each point"):
        plane.project(points)
    points[2, 1] = torch.nan
    with pytest.raises(InputError, match="query point 2"):
        plane.project(points, directions)
