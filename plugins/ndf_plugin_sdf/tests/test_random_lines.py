"""Samples of level sets: on the surface, and even by area."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from ndf_plugin_sdf.csg.tree import parse_tree
from ndf_plugin_sdf.tree_field import TreeField
from sdf_trees import SOLIDS, node

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.random_lines import sample_level_set


def test_samples_lie_on_the_surface_with_its_normals() -> None:
    field = TreeField(parse_tree(SOLIDS["bracket"]))
    points, normals = sample_level_set(field, 5000, np.random.default_rng(0))
    assert points.shape == normals.shape == (5000, 3)
    assert float(field.values(torch.from_numpy(points)).abs().max()) < 1e-8
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-9)
    ahead = field.values(torch.from_numpy(points + 1e-4 * normals)).numpy()
    assert (ahead > 0).mean() > 0.99


def chi_squared(counts: np.ndarray, shares: np.ndarray) -> float:
    expected = counts.sum() * shares
    return float(((counts - expected) ** 2 / expected).sum())


def test_samples_are_even_by_area() -> None:
    """Archimedes: slices of a sphere of equal height have equal area. A box: faces count by area."""
    points, _ = sample_level_set(TreeField(node("sphere", radius=1.0)), 40_000, np.random.default_rng(1))
    for axis in range(3):
        assert chi_squared(np.histogram(points[:, axis], 20, (-1, 1))[0], np.full(20, 0.05)) < 50  # 1e-4: 49
    half = np.array([1.0, 0.5, 0.25])
    points, _ = sample_level_set(TreeField(node("box", size=(2 * half).tolist())), 40_000, np.random.default_rng(2))
    face = np.argmax(np.abs(points) / half, axis=1)
    area = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    assert chi_squared(np.bincount(face), area / area.sum()) < 25
    top = points[face == 2]
    assert chi_squared(np.histogram(top[:, 0], 10, (-1, 1))[0], np.full(10, 0.1)) < 40


def test_torus_samples_follow_its_area() -> None:
    """The area element is (R + r cos v): the outer half has (1/2 + r / (pi R)) of it."""
    field = TreeField(node("torus", major_radius=1.0, minor_radius=0.4))
    points, _ = sample_level_set(field, 40_000, np.random.default_rng(3))
    outer = (np.hypot(points[:, 0], points[:, 1]) > 1.0).mean()
    assert abs(outer - (0.5 + 0.4 / np.pi)) < 4 * 0.5 / 200


def test_the_seed_decides() -> None:
    field = TreeField(parse_tree(SOLIDS["blob"]))
    one = sample_level_set(field, 100, np.random.default_rng(7))[0]
    np.testing.assert_array_equal(one, sample_level_set(field, 100, np.random.default_rng(7))[0])
    assert (one != sample_level_set(field, 100, np.random.default_rng(8))[0]).any()


def test_no_surface_is_an_error() -> None:
    field = TreeField(node("sphere", radius=1.0))
    field.bounds = Box(np.full(3, 2.0), np.full(3, 3.0))
    with pytest.raises(InputError, match="no surface found"):
        sample_level_set(field, 10, np.random.default_rng(0))
