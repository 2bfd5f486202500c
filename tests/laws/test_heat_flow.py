"""Heat flow, paths and logarithmic maps against closed forms on sphere and plane."""

from __future__ import annotations

import numpy as np
import pytest
from flat_surfaces import FlatTorus, pillow
from numpy.polynomial.legendre import Legendre
from small_assets import icosphere

from ndf_core.errors import InputError
from ndf_core.processing.geodesic_paths import geodesic_path
from ndf_core.processing.geodesics import geodesic_distances
from ndf_core.processing.heat_flow import HeatFlow, diffuse
from ndf_core.processing.log_map import VectorHeat
from ndf_core.processing.operators import Operators

SPHERE = Operators(*icosphere(4))
Z = SPHERE.vertices[:, 2]
vertices, faces = icosphere(2)
PAIR = Operators(np.concatenate([vertices, vertices + 5]), np.concatenate([faces, faces + len(vertices)]))


def kernel(time: float) -> np.ndarray:
    """The heat kernel of the unit sphere around its north pole."""
    terms = ((2 * k + 1) / (4 * np.pi) * np.exp(-k * (k + 1) * time) * Legendre.basis(k)(Z) for k in range(60))
    return np.sum(list(terms), axis=0)


def test_diffusion_is_the_heat_kernel_in_the_order_of_the_step() -> None:
    errors = [np.abs(diffuse(SPHERE, [[0, 0, 1]], 0.3, steps) - kernel(0.3)).max() for steps in (16, 32, 64)]
    assert errors[2] < 0.03 * kernel(0.3).max()
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.2)


def test_heat_is_kept_and_stays_in_range() -> None:
    flow = HeatFlow(SPHERE, 0.01)
    sources = SPHERE.closest(np.array([[0, 0, 1.0], [0.3, 0.5, -0.2]]))
    flow.advance(sources, power=5.0, steps=3)
    assert SPHERE.lumped_mass @ flow.heat == pytest.approx(2 * 5.0 * 0.03)
    before = flow.heat.copy()
    after = flow.advance(steps=10)
    assert SPHERE.lumped_mass @ after == pytest.approx(0.3)
    assert before.min() - 1e-12 <= after.min() and after.max() < before.max()


def test_moving_sources_need_no_new_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer is that of a flow that never knew the other source."""
    moved, fresh = HeatFlow(SPHERE, 0.02), HeatFlow(SPHERE, 0.02)
    monkeypatch.setattr("ndf_core.processing.operators.Cholesky", None)
    moved.advance(SPHERE.closest(np.array([[0, 0, 1.0]])))
    moved.reset()
    place = SPHERE.closest(np.array([[1.0, 0, 0]]))
    assert np.array_equal(moved.advance(place), fresh.advance(place))


def test_each_component_keeps_its_own_heat() -> None:
    heat = diffuse(PAIR, [[0, 0, 1]], 0.2)
    assert np.abs(heat[len(vertices) :]).max() < 1e-12


def test_the_flat_torus_forgets_a_wave_at_its_rate() -> None:
    mesh = FlatTorus(48)
    wave = np.cos(2 * np.pi * mesh.vertices[:, 0])
    flow = HeatFlow(mesh, 1e-4)
    flow.reset(wave)
    found = flow.advance(steps=100)
    rate = (1 + 1e-4 * 4 * np.pi**2) ** -100
    assert np.abs(found - rate * wave).max() < 2e-3


def test_paths_are_great_circles_and_straight_lines() -> None:
    start, end = np.array([0, 0, 1.0]), np.array([0.3, 0.9, -0.2])
    path = geodesic_path(SPHERE, start, end)
    angle = np.arccos(end[2] / np.linalg.norm(end))
    assert path.length == pytest.approx(angle, rel=2e-3)
    across = np.cross(start, end / np.linalg.norm(end))
    assert np.abs(path.points @ across).max() < 0.02
    flat = Operators(*pillow(8))
    path = geodesic_path(flat, [0.13, 0.21, 0.0], [0.86, 0.55, 0.0])
    assert path.length == pytest.approx(np.hypot(0.73, 0.34), rel=1e-6)
    assert path.points[[0, -1]] == pytest.approx(np.array([[0.13, 0.21, 0], [0.86, 0.55, 0]]), abs=1e-6)
    assert geodesic_path(flat, [0.2, 0.2, 0], [0.2, 0.2, 0]).length == 0


def test_paths_are_as_long_as_exact_distances() -> None:
    found = geodesic_distances(SPHERE, [[0, 0, 1.0]], "exact").distances
    for vertex in (50, 1000, 2000):
        path = geodesic_path(SPHERE, [0, 0, 1.0], SPHERE.vertices[vertex])
        assert (1 - 1e-9) * found[vertex] <= path.length <= (1 + 1e-4) * found[vertex], "locally the shortest"


def test_there_is_no_path_to_another_component() -> None:
    path = geodesic_path(PAIR, [0, 0, 1], [5, 5, 6])
    assert path.length == np.inf and not len(path.points)
    with pytest.raises(InputError, match="2 components"):
        VectorHeat(PAIR)


def test_the_logarithmic_map_of_the_sphere() -> None:
    """Distance from the pole, and the longitude, up to one rotation."""
    solver = VectorHeat(SPHERE)
    pole = int(solver.nearest_vertices([[0, 0, 1.0]])[0])
    found = solver.log_map(pole)
    away = np.arccos(np.clip(SPHERE.vertices @ SPHERE.vertices[pole], -1, 1))
    near = (away > 0.2) & (away < 2.0)
    assert np.abs(np.hypot(*found.T) - away)[near].max() < 0.06
    first, second = (axis[pole] for axis in solver.tangents)
    longitude = np.arctan2(SPHERE.vertices @ second, SPHERE.vertices @ first)
    turn = np.exp(1j * (np.arctan2(found[:, 1], found[:, 0]) - longitude))[near]
    assert np.abs(turn - 1).max() < 0.1


def test_transport_on_the_sphere_follows_great_circles() -> None:
    solver = VectorHeat(SPHERE)
    pole = solver.nearest_vertices([[0, 0, 1.0]])
    vector = np.array([[1.0, 0, 0]])
    moved = solver.transport(pole, vector)
    x, y, z = SPHERE.vertices.T
    # Along a great circle through the pole the angle to the circle stays.
    longitude = np.arctan2(y, x)
    south = np.stack([z * np.cos(longitude), z * np.sin(longitude), -np.sqrt(np.maximum(1 - z**2, 0))], axis=1)
    east = np.stack([-np.sin(longitude), np.cos(longitude), 0 * x], axis=1)
    expected = np.cos(longitude)[:, None] * south - np.sin(longitude)[:, None] * east
    near = (z > -0.5) & (z < 0.98)
    assert (moved * expected).sum(axis=1)[near].min() > 0.98


def test_what_is_wrong_is_said() -> None:
    cases = [
        (lambda: HeatFlow(SPHERE, 0.0), "must be positive"),
        (lambda: diffuse(SPHERE, [], 1.0), "at least one source"),
        (lambda: diffuse(SPHERE, [[0, 0, 1]], 1.0, 0), "at least one"),
        (lambda: diffuse(SPHERE, [[0, 0, np.nan]], 1.0), "not finite"),
        (lambda: HeatFlow(SPHERE, 1.0).reset(np.zeros(3)), "2,562 finite values"),
        (lambda: geodesic_path(SPHERE, [0, 0, np.inf], [0, 0, 1]), "not finite"),
    ]
    for call, message in cases:
        with pytest.raises(InputError, match=message):
            call()
