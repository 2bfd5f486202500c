"""Soups: what is closed stays exact, holes are capped, parts are turned outwards, sheets become shells."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh
from clouds import closest, near, off_surface, ring
from ndf_plugin_pointcloud.level_set_mesh import WindingExtractor
from ndf_plugin_pointcloud.patches import orient_soup
from ndf_plugin_pointcloud.soup import SoupConfig
from ndf_plugin_pointcloud.soup_surface import open_soup
from ndf_plugin_pointcloud.triangles import Triangles, usable_triangles

from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.errors import InputError
from ndf_core.kernels.winding import WindingTree
from ndf_core.mesh import signed_volume
from ndf_core.readers.polygons import RawMesh

CONFIG = SoupConfig(resolution=64)


def damaged(mesh: trimesh.Trimesh, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Without a tenth of the triangles; the corners of the others moved by 0.1% of the size, each for itself."""
    rng = np.random.default_rng(seed)
    kept = mesh.triangles[rng.random(len(mesh.faces)) > 0.1]
    corners = kept + 1e-3 * mesh.extents.max() * rng.uniform(-1, 1, kept.shape)
    return corners.reshape(-1, 3), np.arange(3 * len(kept)).reshape(-1, 3)


def test_closed_triangles_project_to_the_closest_point() -> None:
    shape = ring()
    surface = open_soup((shape.vertices, shape.faces), CONFIG)
    queries = near(shape, 1500, 0.01)
    found = surface.projector.project(torch.from_numpy(queries))
    assert bool(found.converged.all())
    nearby = closest(shape, queries)[0]
    np.testing.assert_allclose(found.points.numpy(), nearby, atol=1e-9)
    check_base_mesh(surface.base_mesh.extract(400), euler_characteristic=0, components=1)
    # Again, and in any order.
    torch.testing.assert_close(surface.projector.project(found.points).points, found.points, atol=1e-9, rtol=0)
    assert torch.equal(surface.projector.project(torch.from_numpy(queries[::-1].copy())).points.flip(0), found.points)


def test_a_damaged_soup_gives_the_shape_back() -> None:
    shape = ring()
    surface = open_soup(damaged(shape), CONFIG)
    check_base_mesh(surface.base_mesh.extract(400), euler_characteristic=0, components=1)
    found = surface.projector.project(torch.from_numpy(near(shape, 1500, 0.01)))
    assert found.converged.double().mean() > 0.99
    distance = off_surface(shape, found.points[found.converged].numpy())
    assert distance.mean() < 1e-3
    assert np.quantile(distance, 0.99) < 5e-3


def test_holes_are_capped() -> None:
    box = trimesh.creation.box().subdivide().subdivide().subdivide()
    middle = box.triangles_center
    lid = (middle[:, 2] > 0.499) & (np.abs(middle[:, :2]) < 0.3).all(axis=1)
    surface = open_soup((box.vertices, box.faces[~lid]), CONFIG)
    mesh = surface.base_mesh.extract(600)
    check_base_mesh(mesh, euler_characteristic=2, components=1)
    # Over the hole, rays end on the cap, not on the rim.
    queries = np.stack([*np.random.default_rng(0).uniform(-0.1, 0.1, (2, 200)), np.full(200, 0.52)], axis=1)
    found = surface.projector.project(torch.from_numpy(queries))
    assert found.converged.double().mean() > 0.95
    assert float((found.points[found.converged, :2].abs()).max()) < 0.2


def test_parts_that_overlap_are_one_solid() -> None:
    parts = [trimesh.creation.box(), trimesh.creation.box()]
    parts[1].apply_translation([0.5, 0.3, 0.2])
    both = trimesh.util.concatenate(parts)
    surface = open_soup((both.vertices, both.faces), CONFIG)
    check_base_mesh(surface.base_mesh.extract(400), euler_characteristic=2, components=1)
    # A corner of one box inside of the other is no surface: nothing lands there.
    queries = np.array([0.1, -0.1, -0.2]) + np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3))
    found = surface.projector.project(torch.from_numpy(queries))
    inside = (np.abs(found.points.numpy()) < 0.49).all(axis=1)
    assert not (inside & found.converged.numpy()).any()


def test_patches_are_turned_outwards() -> None:
    shape = trimesh.creation.icosphere(subdivisions=3)
    rng = np.random.default_rng(0)
    flips = rng.random(len(shape.faces)) < 0.5
    faces = np.where(flips[:, None], shape.faces[:, ::-1], shape.faces)
    for soup in (
        Triangles(np.asarray(shape.vertices), faces, ()),  # joined: neighbours decide
        Triangles(shape.vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3), ()),  # rays decide
    ):
        oriented, notes = orient_soup(soup)
        assert notes
        assert signed_volume(oriented.vertices, oriented.faces) == pytest.approx(shape.volume)


def test_cavities_stay_as_they_are() -> None:
    outer, inner = trimesh.creation.icosphere(subdivisions=3), trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    inner.invert()
    both = trimesh.util.concatenate([outer, inner])
    oriented, notes = orient_soup(Triangles(np.asarray(both.vertices), np.asarray(both.faces), ()))
    assert not notes
    np.testing.assert_array_equal(oriented.faces, both.faces)


@pytest.mark.parametrize(("thickness", "distance"), [(None, 0.05), (0.03, 0.015)])
def test_sheets_become_shells_and_say_so(thickness: float | None, distance: float) -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40), indexing="ij")
    vertices = np.stack([x, y, 0.3 * np.sin(3 * x) * np.cos(2 * y)], axis=-1).reshape(-1, 3)
    a = (np.arange(39)[:, None] * 40 + np.arange(39)).ravel()
    faces = np.concatenate([np.stack([a, a + 40, a + 41], axis=1), np.stack([a, a + 41, a + 1], axis=1)])
    surface = open_soup((vertices, faces), SoupConfig(radius=0.05, thickness=thickness))
    assert any("dilation" in note for note in surface.notes)
    mesh = surface.base_mesh.extract(600)
    check_base_mesh(mesh, euler_characteristic=2, components=1)
    queries = torch.from_numpy(mesh.vertices)
    found = surface.projector.project(queries)
    assert bool(found.converged.all())
    sheet = trimesh.Trimesh(vertices, faces, process=False)
    np.testing.assert_allclose(closest(sheet, found.points.numpy())[1], distance, atol=5e-3)
    assert surface.sample is not None
    samples, normals = surface.sample(2000, np.random.default_rng(0))
    np.testing.assert_allclose(closest(sheet, samples)[1], distance, atol=5e-3)
    assert normals is not None and 0.4 < (normals[:, 2] > 0).mean() < 0.6  # both sides


def test_rough_loose_triangles_are_no_sheet() -> None:
    """A tenth is missing, the others stick out and show the inside: what they enclose is still seen."""
    ball = trimesh.creation.icosphere(subdivisions=5)
    rng = np.random.default_rng(0)
    corners = ball.triangles[rng.random(len(ball.faces)) >= 0.1]
    corners = corners + 0.015 * rng.uniform(-1, 1, corners.shape)  # half of an edge
    surface = open_soup((corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)), CONFIG)
    assert not any("dilation" in note or "turned over" in note for note in surface.notes)
    mesh = surface.base_mesh.extract(600)
    check_base_mesh(mesh, euler_characteristic=2, components=1)
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(1, abs=0.05)


def test_what_is_no_soup_is_refused() -> None:
    corners, face = np.eye(3), np.array([[0, 1, 2]])
    for vertices, faces, message in (
        (corners, np.array([[0, 1, 3]]), "do not exist"),
        (np.full((3, 3), np.nan), face, "no triangle with finite corners"),
        (np.ones((3, 3)), face, "degenerate"),
        (np.outer(np.arange(3.0), [1, 1, 1]), face, "degenerate"),
    ):
        with pytest.raises(InputError, match=message):
            usable_triangles(RawMesh(vertices, faces), "x")
    for source in (corners, (corners, corners), (corners, face[:0])):
        with pytest.raises(InputError, match="soup: need"):
            open_soup(source, CONFIG)


def test_what_is_left_out_is_said() -> None:
    box = trimesh.creation.box()
    vertices = np.concatenate([box.vertices, [[np.nan, 0, 0]]])
    faces = np.concatenate([box.faces, [[0, 1, 8], [0, 0, 1]], box.faces[:1]])
    read = usable_triangles(RawMesh(vertices, faces), "x")
    assert len(read.faces) == 12
    assert len(read.notes) == 3


def test_a_surface_of_very_large_area_is_looked_at_with_larger_cells() -> None:
    """With four times the area, half as many cells along a side: as many of them meet the surface."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    tree = WindingTree.of_triangles(ball.vertices, ball.faces)
    samples = np.asarray(ball.vertices)
    cells = [WindingExtractor(tree, samples, area, 1e-4, 1024).resolution for area in (4.0, 100.0, 400.0)]
    assert cells[0] > 800
    assert cells[1] == pytest.approx(2 * cells[2], abs=2)
    assert 48 < cells[2] < 100


def test_a_surface_of_very_little_area_is_looked_at_with_smaller_cells() -> None:
    """Of a unit-long one: a quarter of the area, twice the cells along a side."""
    rod = trimesh.creation.box((0.01, 0.01, 1))
    tree = WindingTree.of_triangles(rod.vertices, rod.faces)
    samples = np.asarray(rod.vertices)
    cells = [WindingExtractor(tree, samples, area, 0.0, None).resolution for area in (2.0, 0.5, 0.125, 0.001)]
    assert cells == [256, 256, 512, 1024]


def test_weights_are_those_of_what_projections_are_like() -> None:
    """Closest triangles, rays where parts hide in each other, the two sides of a dilation."""
    shape = ring()
    nested = trimesh.util.concatenate([shape.copy().apply_scale([1, 1, s]) for s in (1.0, 0.98, 0.96)])
    given = [
        open_soup(
            (mesh.vertices, mesh.faces), SoupConfig(resolution=64, method=method, radius=0.2)
        ).training_defaults["loss"]["cycle"]
        for mesh, method in ((shape, "winding"), (nested, "winding"), (shape, "dilation"))
    ]
    assert given == [1e2, 1e4, 1e3]
