"""Threshold, box and background when the user gives none of them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from ndf_plugin_nerf.region import background_cut, find_region
from ndf_plugin_nerf.threshold import threshold_from_histogram
from nerf_shapes import THRESHOLD, ball, density, union
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box


def ground(height: float):
    """Signed distance of everything below a height."""
    return lambda points: points[:, 2] - height


def test_the_box_shrinks_to_the_object() -> None:
    region = find_region(density(ball((0.4, 0.1, -0.2), 0.5)), None, THRESHOLD, 0.05)
    for corner, sign in ((region.box.lower, -1), (region.box.upper, 1)):
        room = sign * (corner - (np.array([0.4, 0.1, -0.2]) + sign * 0.5))
        assert (room > 0.01).all()
        assert (room < 0.1).all()
    assert region.notes == ()


def test_a_background_below_is_cut_off_and_said() -> None:
    scene = density(union(ball((0.0, 0.2, 0.3), 0.6), ground(-0.9)))
    region = find_region(scene, None, THRESHOLD, 0.05)
    assert -0.9 < region.box.lower[2] < -0.3
    (note,) = region.notes
    said = re.search(r"--crop ([-\d.,e]+)", note)
    assert said is not None
    corners = [float(x) for x in said[1].split(",")]
    np.testing.assert_allclose(corners, [*region.box.lower, *region.box.upper], rtol=0.02, atol=2e-3)
    again = find_region(scene, Box(np.array(corners[:3]), np.array(corners[3:])), THRESHOLD, 0.05)
    assert again.notes == ()


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("turned", [False, True])
def test_backgrounds_are_cut_on_any_side(axis: int, turned: bool) -> None:
    solid = np.zeros((20, 20, 20), dtype=bool)
    solid[:4] = True
    solid[10:15, 5:15, 5:15] = True
    expected = slice(4, None)
    if turned:
        solid, expected = solid[::-1], slice(0, 16)
    cut = background_cut(np.moveaxis(solid, 0, axis))
    assert cut is not None
    assert [part for i, part in enumerate(cut) if i != axis] == [slice(None)] * 2
    assert cut[axis] == expected


def test_without_a_closed_object_there_is_an_error_that_says_what_to_do() -> None:
    with pytest.raises(InputError, match=r"forward-facing.*--bounds.*--crop x0,y0,z0,x1,y1,z1"):
        find_region(density(ball((1.3, 0, 0), 1.0)), None, THRESHOLD, 0.05)
    cut = Box(np.array([0.0, -1.2, -1.2]), np.array([1.5, 1.2, 1.2]))
    assert find_region(density(ball((1.3, 0, 0), 1.0)), cut, THRESHOLD, 0.05).box.upper[0] == 1.5


@pytest.mark.parametrize("threshold", [None, 3e3])
def test_nothing_dense_is_an_error_with_the_largest_density(threshold: float | None) -> None:
    fog = density(lambda points: np.full(len(points), 0.0996) + 0 * points[:, 0])  # 0.08 everywhere
    with pytest.raises(InputError, match=r"nothing is (denser than fog|as dense as).*is 0\.08"):
        find_region(fog, None, threshold, 0.05)


def test_the_threshold_encloses_the_matter_and_no_fog() -> None:
    rng = np.random.default_rng(0)
    matter = rng.uniform(100.0, 300.0, 1000)
    fog: Array = rng.uniform(0.0, 4.0, 100_000)
    chosen = threshold_from_histogram(np.concatenate([np.zeros(10_000), matter]), 2.0)
    assert chosen == pytest.approx(np.quantile(matter, 0.05))
    assert threshold_from_histogram(np.concatenate([fog, matter]), 2.0) == 5.0
    assert threshold_from_histogram(fog, 2.0) is None
