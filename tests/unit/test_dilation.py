"""Dilation of points: solid, wall or sheet."""

from __future__ import annotations

import numpy as np
import pytest

from ndf_core.base_mesh.checks import check_base_mesh, component_volumes
from ndf_core.mesh import topology
from ndf_core.surfaces.dilation import DilationExtractor, closing_radius, eroded, offset_surface, sampling_spacing


def sphere(count: int = 3000) -> np.ndarray:
    """Points spread evenly over the unit sphere (Fibonacci's spiral)."""
    index = np.arange(count) + 0.5
    z, turn = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    return np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)


def test_a_filled_sphere_is_a_ball() -> None:
    offset = offset_surface(sphere(), 0.15)
    counts = topology(offset.faces, len(offset.vertices))
    assert (counts.components, counts.genus) == (1, 0)
    assert "filled_interior" in [remark.kind for remark in offset.remarks]
    radius = np.linalg.norm(offset.vertices, axis=1)
    assert radius.min() > 1.13 and radius.max() < 1.151
    mesh = DilationExtractor(offset).extract(500)
    check_base_mesh(mesh, euler_characteristic=2, components=1)
    assert len(mesh.faces) <= 500
    assert mesh.remarks[0].kind == "filled_interior"


def test_eroded_again_it_lies_near_the_points() -> None:
    solid = eroded(offset_surface(sphere(), 0.15), 0.12)
    counts = topology(solid.faces, len(solid.vertices))
    assert (counts.components, counts.genus) == (1, 0)
    radius = np.linalg.norm(solid.vertices, axis=1)
    assert radius.min() > 1.01 and radius.max() < 1.04
    assert "filled_interior" in [remark.kind for remark in solid.remarks]


def test_a_kept_interior_leaves_a_wall_twice_the_radius_thick() -> None:
    offset = offset_surface(sphere(), 0.15, "keep")
    outside, inside = component_volumes(offset.vertices, offset.faces)
    assert outside == pytest.approx(4 / 3 * np.pi * 1.15**3, rel=0.03)
    assert inside == pytest.approx(-4 / 3 * np.pi * 0.85**3, rel=0.03)


def test_what_floats_in_a_hollow_goes_with_it() -> None:
    points = np.concatenate([sphere(), 0.3 * sphere(300)])
    offset = offset_surface(points, 0.12)
    assert topology(offset.faces, len(offset.vertices)).components == 1
    assert np.linalg.norm(offset.vertices, axis=1).min() > 1.0


def test_two_solids_side_by_side_both_stay() -> None:
    offset = offset_surface(np.concatenate([sphere(), sphere() + np.array([3, 0, 0])]), 0.15)
    assert topology(offset.faces, len(offset.vertices)).components == 2


def test_the_radius_closes_the_gaps_and_no_more() -> None:
    points = sphere()
    spacing = float(np.median(sampling_spacing(points)))
    radius = closing_radius(points, spacing, 0.5)
    assert radius is not None and radius < 2 * spacing
    # A window of half-angle 0.2 needs a radius of about 0.2.
    window = closing_radius(points[points[:, 2] < np.cos(0.2)], spacing, 0.5)
    assert window is not None and 0.1 < window < 0.3


@pytest.mark.parametrize("part", [lambda p: p[p[:, 2] > 0], lambda p: p * [1, 1, 0]])
def test_sheets_close_nowhere(part) -> None:
    points = part(sphere())
    assert closing_radius(points, float(np.median(sampling_spacing(points))), 0.3) is None


def test_a_far_outlier_takes_no_memory() -> None:
    points = np.concatenate([sphere(), [[1e7, 1e7, 0.0]]])
    assert closing_radius(points, 0.05, 1e6) is None
