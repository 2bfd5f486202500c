"""Base meshes of closed-form densities, from the level set and from fused depth maps."""

from __future__ import annotations

import numpy as np
import pytest
from ndf_plugin_nerf.grid_extractor import GridExtractor, smoothed
from ndf_plugin_nerf.isosurface import isosurface, sample_triangles
from ndf_plugin_nerf.outer_field import OuterField
from ndf_plugin_nerf.tsdf import cameras, depth_map, fused
from nerf_shapes import THRESHOLD, ball, density, shell, union

from ndf_core.mesh import topology
from ndf_core.surfaces.box import Box

CUBE = Box(np.full(3, -1.5), np.full(3, 1.5))


def outer(distance, resolution: int = 48) -> OuterField:
    return OuterField.of(density(distance), CUBE, THRESHOLD, resolution, 0.05)


@pytest.mark.parametrize("make_grid", [smoothed, pytest.param(fused, marks=pytest.mark.slow)], ids=["outer", "tsdf"])
def test_a_hollow_ball_gives_one_closed_sphere(make_grid) -> None:
    field = outer(shell(0.6, 1.0))
    mesh = GridExtractor(lambda: make_grid(field)).extract(400)
    counts = topology(mesh.faces, len(mesh.vertices))
    assert (counts.closed, counts.manifold, counts.components, counts.genus) == (True, True, 1, 0)
    assert len(mesh.faces) <= 400
    radius = np.linalg.norm(mesh.vertices, axis=1)
    assert abs(radius - 1).max() < 0.03
    again = GridExtractor(lambda: make_grid(field)).extract(400, seed=5)
    np.testing.assert_array_equal(mesh.vertices, again.vertices)


def test_a_narrow_gap_is_spanned_and_a_wide_one_is_kept() -> None:
    # Two half balls with a slit between them, and something that joins them.
    def split(width: float):
        def distance(points):
            slit = np.abs(points[:, 2]) - width / 2
            pillar = np.maximum(np.linalg.norm(points[:, :2], axis=1) - 0.3, np.abs(points[:, 2]) - 0.5)
            return np.minimum(np.maximum(ball()(points), -slit), pillar)

        return distance

    inner_area: list[float] = []
    for width in (0.12, 0.5):  # 1.9 and 8 cells
        nodes, values = smoothed(outer(split(width)))
        points, _ = sample_triangles(isosurface(nodes, values), 4000, np.random.default_rng(0))
        inner_area.append(float((np.linalg.norm(points, axis=1) < 0.85).mean()))
    assert inner_area[0] < 0.05
    assert inner_area[1] > 0.2


def test_depth_maps_see_the_sphere_where_it_is() -> None:
    field = outer(ball())
    some = cameras(field.nodes)
    middles = np.array([camera.axes[2].numpy() for camera in some])
    assert np.abs(middles.sum(axis=0)).max() < 0.05 * len(some)
    for camera in some[:3]:
        np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
        depth = depth_map(field.function(), camera).numpy().ravel()
        points = camera.rays().numpy() + np.nan_to_num(depth, posinf=0.0)[:, None] * camera.axes[2].numpy()
        hit = np.isfinite(depth)
        np.testing.assert_allclose(np.linalg.norm(points[hit], axis=1), 1.0, atol=0.02)
        across = np.linalg.norm(np.cross(camera.rays().numpy(), camera.axes[2].numpy()[None]), axis=1)
        np.testing.assert_array_equal(hit[across < 0.98], True)
        np.testing.assert_array_equal(hit[across > 1.02], False)


@pytest.mark.slow
def test_separate_balls_are_separate_components() -> None:
    field = outer(union(ball((-0.7, 0, 0), 0.5), ball((0.7, 0, 0), 0.5)))
    for make_grid in (smoothed, fused):
        mesh = GridExtractor(lambda make=make_grid: make(field)).extract(300)
        assert topology(mesh.faces, len(mesh.vertices)).components == 2


def test_samples_are_even_and_have_normals() -> None:
    field = outer(ball())
    points, normals = sample_triangles(isosurface(field.nodes, field.values), 20_000, np.random.default_rng(1))
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, atol=3e-3)
    assert (points * normals).sum(1).min() > 0.9
    # On a sphere every coordinate is uniform: the standard error of the variance 1/3 is 0.002.
    np.testing.assert_allclose((points**2).mean(axis=0), 1 / 3, atol=0.01)
