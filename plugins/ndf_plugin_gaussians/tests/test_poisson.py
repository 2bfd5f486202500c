"""Screened Poisson reconstruction on a grid, and the surface drawn from it to the centres: spheres come back, gaps
are bridged, detail comes back and scatter does not, and centres behind others do not draw the surface in."""

from __future__ import annotations

import numpy as np
from ndf_plugin_gaussians.distances import like_distances
from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary, Layer
from ndf_plugin_gaussians.poisson import screened_poisson
from ndf_plugin_gaussians.smooth_surface import plane_distances, smooth_surface
from ndf_plugin_gaussians.solid import Ground, meshed

GRID = Grid.around(np.array([[-1.0, -1, -1], [1, 1, 1]]), 32).refined(1.0)


def directions(count: int) -> np.ndarray:
    """Evenly over the unit sphere, on Fibonacci's spiral."""
    height = (2 * np.arange(count) + 1) / count - 1
    angle = np.pi * (1 + np.sqrt(5)) * np.arange(count)
    ring = np.sqrt(1 - height**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)


def layer(points: np.ndarray, normals: np.ndarray, centres: np.ndarray | None = None) -> Layer:
    """With the points as centres, if none are given."""
    detail = np.full(len(points), 4.0 * GRID.step)
    return Layer(points, normals, np.ones(len(points)), detail, points if centres is None else centres, 0.0)


def held(given: Layer) -> np.ndarray:
    return screened_poisson(GRID, given, 0.7, 256.0)


def nodes(grid: Grid) -> np.ndarray:
    return grid.nodes(np.argwhere(np.ones(grid.shape, dtype=bool)))


def radii(field: np.ndarray) -> np.ndarray:
    """Of the vertices of the zero level set, from the origin."""
    return np.linalg.norm(meshed(field, GRID).vertices, axis=1)


def test_points_of_a_sphere_give_the_sphere() -> None:
    normals = directions(4000)
    field = held(layer(normals, normals))
    inside = np.linalg.norm(nodes(GRID), axis=1).reshape(GRID.shape) < 1.0
    away = np.abs(np.linalg.norm(nodes(GRID), axis=1).reshape(GRID.shape) - 1.0) > GRID.step
    assert ((field > 0) == inside)[away].all()
    assert np.abs(radii(4.0 * field) - 1.0).max() < 0.15 * GRID.step


def test_gaps_are_bridged() -> None:
    normals = directions(4000)
    normals = normals[normals[:, 2] < np.cos(np.radians(25))]
    mesh = meshed(4.0 * held(layer(normals, normals)), GRID)
    over = mesh.vertices[(np.hypot(*mesh.vertices[:, :2].T) < 0.3) & (mesh.vertices[:, 2] > 0)]
    # Between the plane through the rim of the gap, a little below it, and the sphere.
    assert 0.8 < over[:, 2].min() <= over[:, 2].max() < 1.05


def test_detail_comes_back_and_scatter_does_not() -> None:
    normals = directions(16000)
    deep = 0.6 * GRID.step
    # Waves as long as ten cells, that wide smoothing takes away.
    waves = deep * np.sin(10 * normals[:, 2])
    scatter = 0.3 * GRID.step * np.random.default_rng(0).standard_normal(len(normals))
    centres = normals * (1.0 + waves + scatter)[:, None]
    found = meshed(smooth_surface(GRID, layer(normals, normals, centres), centres, None), GRID).vertices
    radius = np.linalg.norm(found, axis=1)
    away = radius - 1.0 - deep * np.sin(10 * found[:, 2] / radius)
    assert away.std() < 0.65 * scatter.std()
    assert away.std() < 0.5 * waves.std()


def test_centres_behind_others_do_not_draw_the_surface_in() -> None:
    rng = np.random.default_rng(0)
    normals = directions(4000)
    seen = normals * (1.0 + 0.1 * GRID.step * rng.standard_normal((4000, 1)))
    hidden = normals[::2] * (1.0 - GRID.step * rng.uniform(1.0, 4.0, (2000, 1)))
    centres = np.concatenate([seen, hidden])
    found = radii(smooth_surface(GRID, layer(normals, normals, centres), centres, None))
    assert abs(np.median(found) - 1.0) < 0.1 * GRID.step
    assert found.std() < 0.1 * GRID.step


def test_most_of_a_sheet_without_thickness_is_kept() -> None:
    side = np.linspace(-0.9, 0.9, 60)
    points = np.stack(np.meshgrid(side, side, [0.0]), axis=-1).reshape(-1, 3)
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    both = np.concatenate([points + 0.4 * GRID.step * up, points - 0.4 * GRID.step * up])
    field = smooth_surface(GRID, layer(both, np.concatenate([up, -up])), both, None)
    middle = GRID.values(field, points[np.abs(points[:, :2]).max(axis=1) < 0.7])
    assert (middle > 0).mean() > 0.85
    vertices = meshed(field, GRID).vertices
    assert np.abs(vertices[:, 2]).max() < 2.0 * GRID.step


def test_below_the_ground_nothing_is_left() -> None:
    normals = directions(4000)
    field = smooth_surface(GRID, layer(normals, normals), normals, Ground((2, -1), -0.5))
    vertices = meshed(field, GRID).vertices
    assert vertices[:, 2].min() > -0.5 - 0.05 * GRID.step
    flat = vertices[np.hypot(*vertices[:, :2].T) < 0.7]
    assert np.ptp(flat[flat[:, 2] < 0, 2]) < 0.1 * GRID.step


def test_numbers_like_distances_have_the_same_zero_set() -> None:
    radius = np.linalg.norm(nodes(GRID), axis=1)
    inside = ((0.8 - radius) / GRID.step * (1.0 + 0.5 * np.sin(3 * nodes(GRID)[:, 0]))).reshape(GRID.shape)
    field = like_distances(inside, GRID, Boundary(meshed(inside, GRID)))
    assert ((field < 0) == (inside > 0)).all()
    np.testing.assert_allclose(
        np.linalg.norm(meshed(-field / GRID.step, GRID).vertices, axis=1), 0.8, atol=0.1 * GRID.step
    )
    near = np.abs(radius - 0.8).reshape(GRID.shape) < 5 * GRID.step
    np.testing.assert_allclose(field[near], (radius - 0.8).reshape(GRID.shape)[near], atol=0.5 * GRID.step)


def test_distances_from_the_neighbours_plane() -> None:
    flat = np.random.default_rng(1).uniform(-1, 1, (500, 3)) * [1.0, 1.0, 0.0]
    assert plane_distances(flat).max() < 1e-12
    raised = np.concatenate([flat, [[0.0, 0.0, 0.05]]])
    assert 0.03 < plane_distances(raised)[-1] < 0.07
