"""The base mesh of a mesh: decimated where it is sound, marching cubes where it runs through itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from solids import ball, box, bumpy, hollow_ball, mesh_of, min_angles, sheet, torus, two_balls

from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.from_mesh import MeshExtractor
from ndf_core.base_mesh.intersections import intersecting_area, self_intersections
from ndf_core.base_mesh.level_set import LevelSetPolicy
from ndf_core.base_mesh.mesh_distance import MeshDistance
from ndf_core.base_mesh.quantise import encode_base_mesh
from ndf_core.base_mesh.untangle import untangle
from ndf_core.errors import BaseMeshError
from ndf_core.mesh import signed_volume, topology

COARSE = LevelSetPolicy(resolution=64, max_resolution=64)


def test_a_sound_mesh_is_decimated() -> None:
    vertices, faces = mesh_of(torus, 48)
    mesh = MeshExtractor(vertices, faces).extract(800)
    counts = topology(mesh.faces, len(mesh.vertices))
    assert counts.genus == 1 and 780 <= counts.faces <= 800 and mesh.remarks == ()


def test_the_face_budget_is_used_and_the_triangles_are_even() -> None:
    mesh = MeshExtractor(*box((1.0, 0.6, 0.1))).extract(1000)
    assert 980 <= len(mesh.faces) <= 1000
    assert np.percentile(min_angles(mesh.vertices, mesh.faces), 5) > 15


def test_marching_cubes_gives_the_same_topology() -> None:
    vertices, faces = mesh_of(hollow_ball, 48)
    mesh = MeshExtractor(vertices, faces, method="marching_cubes", policy=COARSE).extract(800)
    counts = topology(mesh.faces, len(mesh.vertices))
    assert (counts.components, counts.euler_characteristic) == (2, 4) and mesh.remarks == ()


def test_overlapping_parts_become_one_and_that_is_said() -> None:
    one, faces = mesh_of(lambda p: ball(p, radius=0.7), 32)
    vertices, corners = np.concatenate([one, one * 0.9 + [0.5, 0, 0]]), np.concatenate([faces, faces + len(one)])
    mesh = MeshExtractor(vertices, corners.astype(np.int32), policy=COARSE).extract(800)
    assert topology(mesh.faces, len(mesh.vertices)).components == 1
    assert [remark.kind for remark in mesh.remarks] == ["self_intersections", "topology_changed"]
    assert not len(self_intersections(mesh.vertices, mesh.faces))


def test_a_mesh_inside_out_is_turned_round() -> None:
    vertices, faces = mesh_of(bumpy)
    mesh = MeshExtractor(vertices, faces[:, ::-1].copy()).extract(200)
    assert [remark.kind for remark in mesh.remarks] == ["flipped"]
    assert signed_volume(mesh.vertices, mesh.faces) > 0


def test_one_component_inside_out_is_turned_round() -> None:
    vertices, faces = mesh_of(two_balls, 48)
    small = vertices[faces[:, 0], 0] > 0.2
    faces[small] = faces[small][:, ::-1]
    mesh = MeshExtractor(vertices, faces).extract(400)
    assert [(remark.kind, remark.count) for remark in mesh.remarks] == [("flipped", 1)]
    assert topology(mesh.faces, len(mesh.vertices)).components == 2


def test_tiny_components_are_dropped_with_a_remark() -> None:
    vertices, faces = mesh_of(ball)
    both = np.concatenate([vertices, vertices * 1e-3 + [1.2, 0, 0]])
    mesh = MeshExtractor(both, np.concatenate([faces, faces + len(vertices)])).extract(200)
    assert [remark.kind for remark in mesh.remarks] == ["dropped_component"]
    assert mesh.remarks[0].position == pytest.approx((1.2, 0, 0), abs=1e-3)


def test_parts_far_apart_are_both_kept() -> None:
    vertices, faces = mesh_of(ball, 24)
    both = np.concatenate([vertices, vertices + np.array([500.0, 0, 0])])
    mesh = MeshExtractor(both, np.concatenate([faces, faces + len(vertices)])).extract(400)
    encoded = encode_base_mesh(mesh)
    assert topology(encoded.faces, len(encoded.vertices)).components == 2 and mesh.remarks == ()


def test_parts_far_apart_share_the_faces_asked_for() -> None:
    """What counts as thin follows the faces, not the empty space between the parts."""
    part = trimesh.creation.icosphere(3)
    vertices, faces = np.asarray(part.vertices), np.asarray(part.faces, dtype=np.int32)
    both = np.concatenate([vertices, vertices + np.array([1000.0, 0, 0])])
    mesh = MeshExtractor(both, np.concatenate([faces, faces + len(vertices)])).extract(600)
    assert 580 <= len(mesh.faces) <= 600 and mesh.remarks == ()
    assert topology(mesh.faces, len(mesh.vertices)).components == 2


def test_what_is_not_a_closed_mesh_is_refused() -> None:
    with pytest.raises(BaseMeshError, match="not closed: 24 of .*--repr soup"):
        MeshExtractor(*sheet(6))
    with pytest.raises(BaseMeshError, match="at least one face"):
        MeshExtractor(np.zeros((3, 3)), np.zeros((0, 3), np.int32))
    with pytest.raises(BaseMeshError, match="at least one face"):
        MeshExtractor(np.full((8, 3), np.nan), box()[1])


def test_a_pinched_vertex_goes_to_marching_cubes() -> None:
    vertices, faces = box()
    other = np.where(faces == 7, 7, faces + 8)  # a second box, mirrored about the corner (1, 1, 1), shares it
    other[faces == 7] = 7
    both = np.concatenate([vertices, 2 - vertices])
    corners = np.concatenate([faces, other[:, ::-1]]).astype(np.int32)
    with pytest.raises(BaseMeshError, match="1 vertices with several fans"):
        MeshExtractor(both, corners, method="decimate")
    mesh = MeshExtractor(both, corners, policy=COARSE).extract(500)
    assert "not_manifold" in [remark.kind for remark in mesh.remarks]
    assert topology(mesh.faces, len(mesh.vertices)).manifold


def test_the_frame_does_not_matter() -> None:
    vertices, faces = mesh_of(bumpy)
    for scale, offset in ((1e6, 1e6), (1e-6, 1e-6)):
        mesh = MeshExtractor(vertices * scale + offset, faces).extract(300)
        encode_base_mesh(mesh)
        assert np.abs(bumpy((mesh.vertices - offset) / scale)).max() < 0.1


def test_signed_distance_of_a_union() -> None:
    one, faces = mesh_of(lambda p: ball(p, radius=0.7), 48)
    both = np.concatenate([one, one + np.array([0.5, 0, 0])])
    distance = MeshDistance(both, np.concatenate([faces, faces + len(one)]))
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (500, 3))
    expected = np.minimum(ball(points, radius=0.7), ball(points, (0.5, 0, 0), 0.7))
    clear = np.abs(expected) > 0.01
    assert np.array_equal(distance.signed(points)[clear] < 0, expected[clear] < 0)
    outside = expected > 0
    assert distance.unsigned(points)[outside] == pytest.approx(expected[outside], abs=5e-3)


def test_two_sheets_that_press_into_each_other_are_parted() -> None:
    """Two boxes whose facing sides are dented through each other by one vertex."""
    vertices, faces = sheet(6)
    lower = vertices * [1, 1, 0]
    upper = vertices[:, [1, 0, 2]] * [1, 1, 0] + [0, 0, 0.1]  # swapped axes turn the other way
    middle = len(vertices) // 2
    lower[middle, 2] = 0.13
    points, corners = np.concatenate([lower, upper]), np.concatenate([faces, faces + len(vertices)]).astype(np.int32)
    pairs = self_intersections(points, corners)
    assert len(pairs) > 0 and intersecting_area(points, corners, pairs) < 0.3
    parted, rest = untangle(points, corners, pairs)
    assert not len(rest) and not len(self_intersections(parted, corners))
    moved = np.flatnonzero((parted != points).any(axis=1))
    assert len(moved) < 0.3 * len(points)


def test_only_a_manifold_mesh_is_coarsened() -> None:
    vertices, faces = box()
    with pytest.raises(BaseMeshError, match="manifold"):
        coarsen(vertices, np.concatenate([faces, faces[:1, ::-1]]), 100)


@pytest.mark.parametrize(
    ("name", "faces"),
    [("oded_sword.obj", 1000), ("oded_boot.obj", 2000), ("gs3d_xyzrgb_dragon_50k.ply", 2000), ("spot.obj", 8000)],
)
def test_hard_files_keep_their_topology(shared_data: Path, name: str, faces: int) -> None:
    loaded = trimesh.load(shared_data / "mesh" / name, process=False, force="mesh")
    vertices, inverse = np.unique(np.asarray(loaded.vertices), axis=0, return_inverse=True)
    corners = inverse.reshape(-1)[np.asarray(loaded.faces)].astype(np.int32)
    before = topology(corners, len(vertices))
    mesh = MeshExtractor(vertices, corners).extract(faces)
    after = topology(mesh.faces, len(mesh.vertices))
    assert after.manifold and after.closed
    assert (after.euler_characteristic, after.components) == (before.euler_characteristic, before.components)
    assert 0.98 * faces < after.faces <= faces
    assert not len(self_intersections(mesh.vertices, mesh.faces))
    encoded = encode_base_mesh(mesh)
    assert topology(encoded.faces, len(encoded.vertices)).genus == before.genus
