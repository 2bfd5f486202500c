"""Splats on known surfaces give those surfaces: one outer sheet, closed, in the right place, facing outwards."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from ndf_plugin_gaussians.gaussians import GaussiansConfig
from ndf_plugin_gaussians.gaussians_surface import open_gaussians
from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.openness import find_ground, openness
from ndf_plugin_gaussians.solid import meshed
from ndf_plugin_gaussians.splats import Splats
from splat_shapes import floor, joined, on_surface, open_box, sphere

from ndf_core.errors import BaseMeshError, InputError
from ndf_core.interfaces import Surface
from ndf_core.mesh import signed_volume, topology


def opened(splats: Splats, **options: Any) -> Surface:
    return open_gaussians(splats, GaussiansConfig.model_validate({"resolution": 48, **options}))


def test_a_sphere_of_splats_is_a_ball() -> None:
    surface = opened(sphere())
    base = surface.base_mesh.extract(1000)
    counts = topology(base.faces, len(base.vertices))
    assert counts.manifold
    assert (counts.components, counts.genus, counts.closed) == (1, 0, True)
    # One sheet: a double one would have little volume. Within a cell, which is 1/32 of the radius.
    assert signed_volume(base.vertices, base.faces) == pytest.approx(4 / 3 * np.pi, rel=0.06)


def test_projections_lie_on_the_sphere_and_face_outwards() -> None:
    surface = opened(sphere())
    query = torch.from_numpy(np.random.default_rng(1).standard_normal((500, 3)))
    query *= torch.rand(500, 1, generator=torch.Generator().manual_seed(0)) * 0.2 + 0.9
    query /= query.norm(dim=1, keepdim=True)
    query *= torch.linspace(0.93, 1.07, 500)[:, None]
    answer = surface.projector.project(query)
    assert answer.converged.float().mean() > 0.99
    radius = answer.points.norm(dim=1)[answer.converged]
    assert (radius - 1).abs().median() < 0.004
    assert (radius - 1).abs().max() < 0.03
    assert answer.normals is not None
    cosine = (answer.normals * answer.points).sum(1)[answer.converged]
    assert cosine.min() > 0.8
    again = surface.projector.project(answer.points[answer.converged])
    assert (again.points - answer.points[answer.converged]).norm(dim=1).max() < 1e-4


def test_rows_do_not_depend_on_each_other() -> None:
    projector = opened(sphere()).projector
    query = torch.from_numpy(np.random.default_rng(2).uniform(-1.1, 1.1, (64, 3)))
    whole = projector.project(query)
    part = projector.project(query[17:20])
    torch.testing.assert_close(part.points, whole.points[17:20], rtol=0, atol=0)


def test_the_result_moves_with_the_splats() -> None:
    splats = sphere()
    moved = replace(splats, centres=1e-3 * splats.centres + 1e3, scales=1e-3 * splats.scales)
    one, other = (opened(each).base_mesh.extract(200) for each in (splats, moved))
    assert signed_volume(other.vertices - 1e3, other.faces) == pytest.approx(
        1e-9 * signed_volume(one.vertices, one.faces), rel=0.01
    )


def test_the_closest_centre_is_the_paper_s_projection() -> None:
    splats = sphere(500)
    surface = opened(splats, projection="centre")
    query = np.random.default_rng(3).uniform(-1, 1, (50, 3))
    answer = surface.projector.project(torch.from_numpy(query))
    brute = np.linalg.norm(query[:, None] - splats.centres, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(answer.points.numpy(), splats.centres[brute])
    assert answer.normals is None


def test_dilation_of_a_sphere_is_filled() -> None:
    base = opened(sphere(), base_mesh="dilation").base_mesh.extract(500)
    counts = topology(base.faces, len(base.vertices))
    assert (counts.components, counts.genus) == (1, 0)
    assert signed_volume(base.vertices, base.faces) > 4 / 3 * np.pi


def test_a_box_open_underneath_is_closed_where_it_stands() -> None:
    surface = opened(open_box())
    assert any("stands on -z (found to be open underneath)" in note for note in surface.notes)
    assert any("no splats near it" in note for note in surface.notes)
    base = surface.base_mesh.extract(500)
    assert topology(base.faces, len(base.vertices)).genus == 0
    assert signed_volume(base.vertices, base.faces) == pytest.approx(12.0, rel=0.15)


def test_a_closed_thing_stands_on_nothing_and_is_no_sheet() -> None:
    assert not any("stands on" in note or "sheet" in note for note in opened(sphere()).notes)


def test_a_floor_becomes_a_slab_behind_the_side_that_things_stand_on() -> None:
    ball = sphere(1500)
    ball = replace(ball, centres=0.5 * ball.centres + np.array([0, 0, 0.5]))
    surface = opened(joined(floor(), ball))
    assert any("seen from (0.00, 0.00, 1.00)" in note.replace("-0.00", "0.00") for note in surface.notes)
    vertices = surface.base_mesh.extract(2000).vertices
    aside = vertices[(np.abs(vertices[:, :2]).max(axis=1) < 1.8) & (np.hypot(*vertices[:, :2].T) > 0.9)]
    assert np.abs(aside[aside[:, 2] > -0.05, 2]).max() < 0.03  # the side that was seen stays
    assert 0.1 < -aside[aside[:, 2] < -0.05, 2].mean() < 0.3
    assert not any("sheet" in note for note in opened(joined(floor(), ball), thicken=False).notes)


@pytest.mark.slow
def test_splats_that_are_there_many_times_do_no_harm() -> None:
    base = opened(joined(*[sphere(1500, width=0.07)] * 6)).base_mesh.extract(500)
    assert signed_volume(base.vertices, base.faces) == pytest.approx(4 / 3 * np.pi, rel=0.06)


def test_faces_stay_where_centres_are_dense() -> None:
    dense = sphere(6000)
    splats = joined(sphere(), dense.take(dense.centres[:, 2] > 0))
    base = opened(splats).base_mesh.extract(1000)
    above = base.vertices[base.faces].mean(axis=1)[:, 2] > 0
    assert 1.2 < above.sum() / (~above).sum() < 4.0


def test_small_holes_do_not_let_the_outside_in() -> None:
    splats = sphere(6000, width=0.04)
    hole = splats.centres[:, 0] > 0.98
    base = opened(splats.take(~hole)).base_mesh.extract(500)
    assert signed_volume(base.vertices, base.faces) == pytest.approx(4 / 3 * np.pi, rel=0.08)


def test_floaters_giants_and_faint_splats_are_left_out_and_said() -> None:
    rng = np.random.default_rng(4)
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    far = on_surface(rng.uniform(8, 9, (3, 3)), up, 0.05)
    giant = on_surface(np.zeros((3, 3)), up, 2.0)
    faint = on_surface(1.3 * sphere(200).centres, sphere(200).centres, 0.05, opacity=0.05)
    lone = on_surface(np.array([[1.15, 1.15, 1.15]]), up[:1], 0.01)
    surface = opened(joined(sphere(), far, giant, faint, lone), isolation=4.0)
    for text in ("3 splats farther out", "3 splats larger", "200 splats fainter", "1 splats 4 times as alone"):
        assert any(text in note for note in surface.notes), (text, surface.notes)
    base = surface.base_mesh.extract(500)
    assert signed_volume(base.vertices, base.faces) == pytest.approx(4 / 3 * np.pi, rel=0.08)


def test_nodes_at_the_level_make_no_triangles_too_small_to_store() -> None:
    grid = Grid.around(np.array([[-1.0, -1, -1], [1, 1, 1]]), 20)
    nodes = grid.nodes(np.argwhere(np.ones(grid.shape, dtype=bool)))
    field = np.clip((0.8 - np.linalg.norm(nodes, axis=1)) / grid.step, -1, 1).reshape(grid.shape)
    field[np.abs(field) < 0.3] = 1e-12
    mesh = meshed(field, grid)
    edges = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)]
    assert np.linalg.norm(edges, axis=2).min() > 0.01 * grid.step


def test_components_are_kept_by_size() -> None:
    small = sphere(300)
    small = replace(small, centres=0.2 * small.centres + np.array([1.6, 0, 0]), scales=0.4 * small.scales)
    both = joined(sphere(), small)
    kept = opened(both, min_component=0.001).base_mesh.extract(1000)
    assert topology(kept.faces, len(kept.vertices)).components == 2
    dropped = opened(both, min_component=0.1)
    assert any("1 components kept, 1 smaller than 0.1" in note for note in dropped.notes)
    base = dropped.base_mesh.extract(1000)
    assert topology(base.faces, len(base.vertices)).components == 1


def test_a_crop_box_leaves_half_a_ball() -> None:
    surface = opened(sphere(), crop=(-2, -2, 0, 2, 2, 2))
    assert any("outside the crop box" in note for note in surface.notes)
    base = surface.base_mesh.extract(500)
    assert base.vertices[:, 2].min() > -0.15


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        ({"opacities": np.zeros(3000)}, InputError, "0 splats are left.*fainter than 0.1"),
        ({"centres": np.ones((3000, 3))}, InputError, "lie in one point"),
        ({"centres": np.zeros((3000, 3))}, InputError, "lie in one point"),
    ],
)
def test_splats_without_a_surface_are_refused(change: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        opened(replace(sphere(), **change))


def test_splats_on_a_line_give_a_rod_or_one_clear_error() -> None:
    line = np.stack([np.linspace(0, 1, 300), np.zeros(300), np.zeros(300)], axis=1)
    for width in (0.05, 0.0):
        splats = on_surface(line, np.tile([0.0, 0.0, 1.0], (300, 1)), width)
        try:
            base = opened(splats).base_mesh.extract(200)
            assert topology(base.faces, len(base.vertices)).closed
        except (InputError, BaseMeshError) as error:
            assert "\n" not in str(error)


def test_openness_is_zero_inside_and_a_good_half_above_a_plate() -> None:
    shell = np.zeros((24, 24, 24), dtype=bool)
    shell[4:20, 4:20, 4:20] = True
    shell[6:18, 6:18, 6:18] = False
    seen = openness(shell)
    assert seen[12, 12, 12] == 0
    assert seen[0, 0, 0] > 0.8
    plate = np.zeros((41, 41, 21), dtype=bool)
    plate[:, :, 10] = True
    assert 0.5 <= openness(plate)[20, 20, 11] < 0.65  # directions along the plate count as open


def test_the_ground_is_where_the_opening_is() -> None:
    for axis, sign in ((0, 1), (1, -1), (2, 1)):
        cup = np.zeros((48, 48, 48), dtype=bool)
        cup[8:40, 8:40, 8:40] = True
        inner = [slice(10, 38)] * 3
        inner[axis] = slice(10, 40) if sign > 0 else slice(8, 38)
        cup[tuple(inner)] = False
        assert find_ground(cup) == (axis, sign)
