"""Primitives against points sampled on their surfaces by formulas of their own, and against membership tests."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from ndf_plugin_sdf.csg.node import Node
from scipy.spatial import KDTree
from sdf_trees import cloud, gradients, node, values

Points = np.ndarray
TURN = 2 * np.pi
GAP = 0.02
"""No point of a sampled surface is farther from the next sample."""


def _square(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A grid on the unit square, its border included."""
    steps = np.linspace(0.0, 1.0, count)
    u, v = np.meshgrid(steps, steps)
    return u.ravel(), v.ravel()


def _ball(n: int = 160_000) -> Points:
    """Fibonacci's spiral: equal areas, no poles."""
    k = np.arange(n) + 0.5
    z, angle = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def _cube(half: np.ndarray, n: int = 200) -> Points:
    u, v = 2 * np.stack(_square(n)) - 1
    one = np.ones_like(u)
    faces = [
        np.stack(order, axis=1) for s in (1, -1) for order in ((s * one, u, v), (u, s * one, v), (u, v, s * one))
    ]
    return np.concatenate(faces) * half


def _around_core(core: np.ndarray, radius: float) -> Points:
    """The points at distance `radius` from the box [-core, core]."""
    beyond = _cube(core + 1.5 * radius)
    nearest = np.clip(beyond, -core, core)
    away = beyond - nearest
    return nearest + radius * away / np.linalg.norm(away, axis=1, keepdims=True)


def _revolved(profile: Points, n: int) -> Points:
    """A curve in (distance from the axis, height), turned about z."""
    angle = TURN * (np.arange(n) + 0.5) / n
    r, z = np.repeat(profile[:, 0], n), np.repeat(profile[:, 1], n)
    a = np.tile(angle, len(profile))
    return np.stack([r * np.cos(a), r * np.sin(a), z], axis=1)


def _line(*corners: tuple[float, float], n: int = 250) -> Points:
    t = np.linspace(0, 1, n)[:, None]
    return np.concatenate([np.array(a) * (1 - t) + np.array(b) * t for a, b in itertools.pairwise(corners)])


def _arc(center: tuple[float, float], radius: float, start: float, end: float, n: int = 300) -> Points:
    a = np.linspace(start, end, n)
    return np.stack([center[0] + radius * np.cos(a), center[1] + radius * np.sin(a)], axis=1)


def _inside_profile(profile: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Callable[[Points], np.ndarray]:
    return lambda p: profile(np.hypot(p[:, 0], p[:, 1]), p[:, 2])


AXIS = {"start": [0, 0, -0.5], "end": [0, 0, 0.7]}
HALF = np.array([0.8, 0.5, 0.3])
RADII = np.array([1.0, 0.4, 0.7])
CASES: dict[str, tuple[Node, Points, Callable[[Points], np.ndarray]]] = {
    "sphere": (
        node("sphere", radius=0.7, center=[0.1, 0.2, -0.3]),
        0.7 * _ball() + [0.1, 0.2, -0.3],
        lambda p: ((p - [0.1, 0.2, -0.3]) ** 2).sum(1) < 0.49,
    ),
    "box": (node("box", size=(2 * HALF).tolist()), _cube(HALF), lambda p: (np.abs(p) < HALF).all(1)),
    "rounded_box": (
        node("rounded_box", size=(2 * HALF).tolist(), radius=0.2),
        _around_core(HALF - 0.2, 0.2),
        lambda p: (np.maximum(np.abs(p) - (HALF - 0.2), 0) ** 2).sum(1) < 0.04,
    ),
    "torus": (
        node("torus", major_radius=0.8, minor_radius=0.25),
        _revolved(_arc((0.8, 0), 0.25, 0, TURN), 400),
        _inside_profile(lambda r, z: (r - 0.8) ** 2 + z**2 < 0.0625),
    ),
    "capsule": (
        node("capsule", radius=0.3, **AXIS),
        _revolved(
            np.concatenate([_arc((0, -0.5), 0.3, -np.pi / 2, 0), _line((0.3, -0.5), (0.3, 0.7)),
                            _arc((0, 0.7), 0.3, 0, np.pi / 2)]), 400),
        _inside_profile(lambda r, z: r**2 + (z - np.clip(z, -0.5, 0.7)) ** 2 < 0.09),
    ),
    "capped_cylinder": (
        node("capped_cylinder", radius=0.4, **AXIS),
        _revolved(_line((0, -0.5), (0.4, -0.5), (0.4, 0.7), (0, 0.7)), 400),
        _inside_profile(lambda r, z: (r < 0.4) & (z > -0.5) & (z < 0.7)),
    ),
    "cone": (
        node("cone", start_radius=0.6, end_radius=0.0, **AXIS),
        _revolved(_line((0, -0.5), (0.6, -0.5), (0, 0.7)), 400),
        _inside_profile(lambda r, z: (z > -0.5) & (r < 0.6 * (0.7 - z) / 1.2)),
    ),
    "frustum": (
        node("cone", start_radius=0.2, end_radius=0.6, **AXIS),
        _revolved(_line((0, -0.5), (0.2, -0.5), (0.6, 0.7), (0, 0.7)), 400),
        _inside_profile(lambda r, z: (z > -0.5) & (z < 0.7) & (r < 0.2 + 0.4 * (z + 0.5) / 1.2)),
    ),
    "ellipsoid": (
        node("ellipsoid", radii=RADII.tolist()),
        _ball(200_000) * RADII,
        lambda p: ((p / RADII) ** 2).sum(1) < 1,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_field_is_the_signed_distance(name: str) -> None:
    tree, surface, inside = CASES[name]
    points = cloud(1, 3000, 1.6)
    reference, _ = KDTree(surface).query(points)
    field = values(tree, points)
    # A sample lies within GAP of the closest point, which makes a distance d look larger by GAP^2 / (2 d) or less.
    slack = np.minimum(GAP, GAP**2 / (2 * np.maximum(reference, 1e-9)))
    assert (np.abs(field) <= reference + 1e-9).all()
    assert (np.abs(field) >= reference - slack).all()
    clear = np.abs(field) > 1e-6
    assert ((field < 0) == inside(points))[clear].all()


@pytest.mark.parametrize("name", CASES)
def test_surface_points_have_distance_zero(name: str) -> None:
    tree, surface, _ = CASES[name]
    np.testing.assert_allclose(values(tree, surface[::31]), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_gradient_is_the_derivative_and_has_length_one(name: str) -> None:
    tree, _, _ = CASES[name]
    points, step = cloud(2, 2000, 1.6), 1e-6
    gradient = gradients(tree, points)
    moves = np.eye(3) * step
    numeric = np.stack([(values(tree, points + m) - values(tree, points - m)) / (2 * step) for m in moves], axis=1)
    # Differences taken across an edge or the medial axis mean nothing: leave out where they are not of length one.
    smooth = np.abs(np.linalg.norm(numeric, axis=1) - 1) < 1e-7
    assert smooth.mean() > 0.98
    np.testing.assert_allclose(gradient[smooth], numeric[smooth], atol=2e-7)


@pytest.mark.parametrize("name", CASES)
def test_gradient_is_right_on_the_surface_itself(name: str) -> None:
    tree, surface, _ = CASES[name]
    points = surface[np.random.default_rng(0).permutation(len(surface))[:500]]
    normal = gradients(tree, points)
    length = np.linalg.norm(normal, axis=1)
    smooth = np.abs(length - 1) < 1e-6  # not on edges, where it is a mean
    assert smooth.mean() > 0.9
    ahead = values(tree, points[smooth] + 1e-5 * normal[smooth])
    np.testing.assert_allclose(ahead, 1e-5, rtol=1e-3)


@pytest.mark.parametrize("name", CASES)
def test_gradient_is_finite_at_centres_axes_and_edges(name: str) -> None:
    grid = np.array([-1.0, -0.5, -0.3, 0.0, 0.3, 0.5, 0.7, 0.8])
    special = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 3)
    tree = CASES[name][0]
    assert np.isfinite(values(tree, special)).all()
    found = gradients(tree, special)
    assert np.isfinite(found).all()
    assert (np.linalg.norm(found, axis=1) <= 1 + 1e-9).all()


def test_plane_is_solid_behind_its_normal() -> None:
    plane = node("plane", normal=[0, 0, 2], offset=0.5)
    np.testing.assert_allclose(values(plane, np.array([[3.0, 1, 0.5], [0, 0, 2], [0, 0, -1]])), [0, 1.5, -1.5])


def test_solids_of_revolution_take_any_axis() -> None:
    """A turned and moved solid is the solid with a turned and moved axis."""
    turn = {"axis": [1, 2, 3], "angle": 50.0}
    matrix = node("rotate", child={"type": "sphere", "radius": 1}, **turn).matrix  # pyright: ignore
    points = cloud(3, 500, 2.0)
    for kind, fields in (
        ("capsule", {"radius": 0.2}),
        ("capped_cylinder", {"radius": 0.2}),
        ("cone", {"start_radius": 0.4}),
    ):
        child = {"type": kind, **AXIS, **fields}
        own = node(kind, start=(matrix @ AXIS["start"]).tolist(), end=(matrix @ AXIS["end"]).tolist(), **fields)
        np.testing.assert_allclose(
            values(own, points), values(node("rotate", child=child, **turn), points), atol=1e-12
        )
    ring = {"type": "torus", "major_radius": 1, "minor_radius": 0.2}
    own = node(**ring, axis=(matrix @ [0, 0, 1]).tolist())
    np.testing.assert_allclose(values(own, points), values(node("rotate", child=ring, **turn), points), atol=1e-12)


def test_ellipsoid_with_equal_radii_is_a_sphere() -> None:
    points = np.concatenate([cloud(4, 1000, 2.0), np.zeros((1, 3)), np.eye(3) * 0.3])
    np.testing.assert_allclose(
        values(node("ellipsoid", radii=[0.7] * 3), points), values(node("sphere", radius=0.7), points), atol=1e-12
    )
