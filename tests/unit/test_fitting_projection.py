"""Projectors seen from the box frame."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from small_surfaces import (
    CENTER,
    RADIUS,
    Altered,
    SphereProjector,
    TorusProjector,
    upper_half_fails,
    upper_half_is_nan,
    without_normals,
)

from ndf_core.fitting.projection import BoxProjector

SCALE = RADIUS / 1.5


def queries(count: int = 200) -> torch.Tensor:
    return torch.randn(count, 3, generator=torch.Generator().manual_seed(0))


def test_box_frame_to_input_units_and_back() -> None:
    """In the box frame the sphere has radius 1.5 and lies at the origin."""
    points = queries()
    before = points.clone()
    answer = BoxProjector(SphereProjector(), np.array(CENTER), SCALE).project(points)
    unit = torch.nn.functional.normalize(points, dim=1)
    assert torch.equal(points, before)
    assert bool(answer.converged.all())
    assert answer.points.dtype == torch.float32
    torch.testing.assert_close(answer.points, 1.5 * unit, rtol=0, atol=1e-6)
    assert answer.normals is not None
    torch.testing.assert_close(answer.normals, unit, rtol=0, atol=1e-6)


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("size", [1e-4, 1.0])
def test_far_away_is_as_good(offset: float, size: float) -> None:
    """At 1e6 units from the origin float32 would be off by 0.06."""
    center, radius = (offset, -offset, offset), 1.5 * size
    projector = BoxProjector(SphereProjector(center, radius), np.array(center), size)
    points = queries()
    expected = 1.5 * torch.nn.functional.normalize(points, dim=1)
    # float64 keeps 2e-10 at 1e6: that is 2e-6 of a box whose unit is 1e-4.
    torch.testing.assert_close(projector.project(points).points, expected, rtol=0, atol=1e-5 if offset else 1e-6)


@pytest.mark.parametrize("fault", [upper_half_fails, upper_half_is_nan])
def test_rows_that_fail_repeat_the_query_without_a_normal(fault: object) -> None:
    points = queries()
    bad = points[:, 2] > 0
    good = BoxProjector(SphereProjector(), np.array(CENTER), SCALE).project(points)
    answer = BoxProjector(Altered(SphereProjector(), fault), np.array(CENTER), SCALE).project(points)
    assert answer.normals is not None and good.normals is not None
    assert torch.equal(answer.converged, ~bad)
    assert torch.equal(answer.points[bad], points[bad])
    assert not answer.normals[bad].any()
    assert torch.equal(answer.points[~bad], good.points[~bad])
    assert torch.equal(answer.normals[~bad], good.normals[~bad])


def test_no_normals_stay_none_and_no_gradient_passes() -> None:
    projector = BoxProjector(Altered(SphereProjector(), without_normals), np.array(CENTER), SCALE)
    answer = projector.project(queries().requires_grad_())
    assert answer.normals is None
    assert not answer.points.requires_grad


def test_directions_arrive_in_double() -> None:
    inner = Altered(SphereProjector(), lambda query, answer: answer, needs_directions=True)
    projector = BoxProjector(inner, np.array(CENTER), SCALE)
    assert projector.needs_directions
    directions = torch.nn.functional.normalize(queries(), dim=1)
    projector.project(queries(), directions)
    assert inner.directions[0] is not None
    assert inner.directions[0].dtype == torch.float64
    torch.testing.assert_close(inner.directions[0].float(), directions)


def test_the_torus_of_the_tests_is_one() -> None:
    """Idempotent, on the implicit torus, with normals that lead there."""
    points = queries().double()
    answer = TorusProjector().project(points)
    found = answer.points
    distance = torch.hypot(torch.hypot(found[:, 0], found[:, 1]) - 1.0, found[:, 2]) - 0.4
    torch.testing.assert_close(distance, torch.zeros(len(points), dtype=torch.float64), rtol=0, atol=1e-6)
    torch.testing.assert_close(TorusProjector().project(found).points, found, rtol=0, atol=1e-6)
    assert answer.normals is not None
    cross = torch.linalg.cross(points - found, answer.normals)
    torch.testing.assert_close(cross, torch.zeros_like(cross), rtol=0, atol=1e-5)


@pytest.mark.parametrize("fault", [upper_half_fails, without_normals])
def test_many_points_are_shared_out_in_order(fault: object) -> None:
    points = queries(7000)
    directions = torch.nn.functional.normalize(points, dim=1)
    alone, shared = (Altered(SphereProjector(), fault, needs_directions=True) for _ in range(2))
    one = BoxProjector(alone, np.array(CENTER), SCALE, threads=5).project(points, directions)
    shared.parallel = True
    three = BoxProjector(shared, np.array(CENTER), SCALE, threads=5).project(points, directions)
    assert len(alone.directions) == 1 and len(shared.directions) == 3, "parallel, and 2,048 points or more each"
    for one_part, other in zip(one, three, strict=True):
        assert (one_part is None) == (other is None)
        assert one_part is None or torch.equal(one_part, other)
