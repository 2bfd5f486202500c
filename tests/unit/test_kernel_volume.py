"""The interpolation kernel against its reference, and the laws of each interpolant."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from ndf_core.kernels.reference.volume import sample_volume as reference
from ndf_core.kernels.volume import KINDS, Kind, sample_volume

RNG = np.random.default_rng(0)
VALUES = RNG.normal(size=(6, 7, 5)).astype(np.float32)


def coefficients(kind: Kind) -> np.ndarray:
    values = ndimage.spline_filter(VALUES, 3, output=np.float32, mode="mirror") if kind == "b_spline" else VALUES
    return np.pad(values, 1, mode="reflect")


@pytest.mark.parametrize("kind", KINDS)
def test_the_kernel_computes_what_the_reference_does(kind: Kind) -> None:
    points = np.concatenate([RNG.uniform(-1.5, 7.5, (100, 3)), [[0, 0, 0], [5, 6, 4], [2, 3, 1], [5, 2.5, 4]]])
    values, gradients = sample_volume(coefficients(kind), points, kind)
    expected = reference(coefficients(kind), points, kind)
    np.testing.assert_allclose(values, expected[0], atol=1e-12)
    np.testing.assert_allclose(gradients, expected[1], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_every_interpolant_goes_through_the_voxels(kind: Kind) -> None:
    index = np.ascontiguousarray(np.argwhere(np.ones(VALUES.shape)), np.float64)
    values, _ = sample_volume(coefficients(kind), index, kind)
    np.testing.assert_allclose(values, VALUES.ravel(), atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_those_of_the_values(kind: Kind) -> None:
    points = RNG.uniform(0.05, 0.95, (200, 3)) + RNG.integers(0, 4, (200, 3))
    _, gradients = sample_volume(coefficients(kind), points, kind)
    for axis in range(3):
        step = np.eye(3)[axis] * 1e-5
        ahead, behind = (sample_volume(coefficients(kind), points + sign * step, kind)[0] for sign in (1, -1))
        np.testing.assert_allclose(gradients[:, axis], (ahead - behind) / 2e-5, atol=1e-7)


def test_bad_arguments_are_refused() -> None:
    good = coefficients("linear")
    for points, words in ((np.full((2, 3), np.nan), "row 0 is not finite"), (np.zeros((2, 2)), "3 columns")):
        with pytest.raises(ValueError, match=words):
            sample_volume(good, points, "linear")
    with pytest.raises(ValueError, match="sizes do not fit"):
        sample_volume(good[:3], np.zeros((1, 3)), "linear")
    with pytest.raises(ValueError, match="format 'f'"):
        sample_volume(good.astype(np.float64), np.zeros((1, 3)), "linear")
