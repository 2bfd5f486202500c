"""From triangles to a closed surface: what is mended, what is said about it, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_files import ball, cube, together, torus

from ndf_core.errors import InputError
from ndf_core.mesh import signed_volume, topology
from ndf_core.readers.polygons import RawMesh
from ndf_core.surfaces.closed_mesh import ClosedMesh, closed_mesh

RNG = np.random.default_rng(0)


def closed(vertices: np.ndarray, faces: np.ndarray, tolerance: float | None = None) -> ClosedMesh:
    mesh = closed_mesh(RawMesh(np.asarray(vertices, float), np.asarray(faces, np.int64)), tolerance, "a.ply")
    counts = topology(mesh.faces, len(mesh.vertices))
    assert counts.closed
    assert counts.manifold
    assert mesh.faces.dtype == np.int32
    return mesh


def separate(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of their own, as in an STL."""
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


def test_a_good_mesh_is_left_as_it_is() -> None:
    for vertices, faces in (ball(), torus(), cube()):
        mesh = closed(vertices, faces)
        np.testing.assert_array_equal(mesh.vertices, vertices)
        np.testing.assert_array_equal(mesh.faces, faces)
        assert mesh.notes == ()


def test_equal_vertices_are_merged() -> None:
    vertices, faces = torus()
    mesh = closed(*separate(vertices, faces))
    counts = topology(mesh.faces, len(mesh.vertices))
    assert (counts.vertices, counts.genus) == (len(vertices), 1)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], vertices[faces])
    assert mesh.notes == (f"{3 * len(faces) - len(vertices):,} vertices merged with others at the same place",)


def test_minus_zero_is_zero() -> None:
    vertices, faces = cube()
    vertices = vertices + 1.0
    apart, triangles = separate(vertices, faces)
    zeros = apart == 0
    apart[zeros] = np.where(RNG.random(zeros.sum()) < 0.5, -0.0, 0.0)
    assert len(closed(apart, triangles).vertices) == 8


def test_rounding_of_single_precision_is_bridged_unless_forbidden() -> None:
    vertices, faces = separate(*torus())
    shaken = vertices * (1 + 1e-7 * RNG.uniform(-1, 1, vertices.shape))
    assert topology(closed(shaken, faces).faces, 288).genus == 1
    with pytest.raises(InputError, match="boundary edges"):
        closed(shaken, faces, 0.0)
    with pytest.raises(InputError, match="boundary edges"):
        closed(vertices + 1e-4 * RNG.uniform(-1, 1, vertices.shape), faces)
    assert topology(closed(vertices + 1e-5 * RNG.uniform(-1, 1, vertices.shape), faces, 1e-4).faces, 288).genus == 1


def test_parts_that_touch_stay_apart_where_the_indices_say_so() -> None:
    """Two cubes that share an edge: merged they would have an edge with four triangles."""
    one, faces = cube()
    other = one + np.array([2, 2, 0])
    mesh = closed(*together((one, faces), (other, faces)))
    assert topology(mesh.faces, len(mesh.vertices)).components == 2
    assert mesh.notes == ()
    with pytest.raises(
        InputError, match=r"not a manifold: it has 1 edges with more than two triangles, one near \(1, 1"
    ):
        closed(*separate(*together((one, faces), (other, faces))))


def test_parts_that_touch_in_a_point_are_split() -> None:
    one, faces = cube()
    mesh = closed(*separate(*together((one, faces), (one + 2, faces))))
    assert topology(mesh.faces, len(mesh.vertices)).components == 2
    assert len(mesh.vertices) == 16
    assert "1 vertices split where parts of the surface touch in a point" in mesh.notes


def test_degenerate_and_duplicate_triangles_are_dropped() -> None:
    vertices, faces = cube()
    extra = np.array([[0, 0, 1], [2, 2, 2], faces[4], faces[7][[1, 2, 0]]])
    mesh = closed(vertices, np.concatenate([faces, extra]))
    assert len(mesh.faces) == 12
    assert mesh.notes == ("2 degenerate triangles dropped", "2 duplicate triangles dropped")


def test_triangles_without_area_stay_where_they_close_the_surface() -> None:
    """A vertex on an edge: without the flat triangle there would be a crack."""
    vertices, faces = cube()
    a, b, c = faces[0]
    middle = len(vertices)
    vertices = np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]])
    # The neighbour across a-b keeps its whole edge.
    faces = np.concatenate([faces[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
    mesh = closed(vertices, faces)
    assert len(mesh.faces) == 14


def test_faces_are_turned_over_to_agree() -> None:
    vertices, faces = torus()
    wrong = RNG.permutation(len(faces))[:50]
    broken = faces.copy()
    broken[wrong] = broken[wrong][:, ::-1]
    mesh = closed(vertices, broken)
    assert mesh.notes == ("50 triangles turned over to face the same way as their neighbours",)
    assert signed_volume(mesh.vertices, mesh.faces) > 0


def test_inside_out_is_noted_and_mended() -> None:
    vertices, faces = torus()
    mesh = closed(vertices, faces[:, ::-1])
    assert mesh.notes == ("the mesh was inside out; all triangles turned over",)
    assert signed_volume(mesh.vertices, mesh.faces) > 0


def test_components_face_outwards_and_cavities_inwards() -> None:
    outer, small, other = ball(2, 2.0), ball(1, 0.5), ball(1, 1.0, (5, 0, 0))
    flipped = (other[0], other[1][:, ::-1])
    mesh = closed(*together(outer, flipped))
    assert mesh.notes == ("1 components were inside out and have been turned over",)
    both = signed_volume(*outer) + signed_volume(*other)
    assert abs(signed_volume(mesh.vertices, mesh.faces) - both) < 1e-9
    cavity = closed(*together(outer, (small[0], small[1][:, ::-1])))
    assert cavity.notes == ()
    volume = signed_volume(*outer) - signed_volume(*small)
    assert abs(signed_volume(cavity.vertices, cavity.faces) - volume) < 1e-9


def test_open_meshes_are_refused_with_the_count_and_a_way_out() -> None:
    vertices, faces = torus()
    with pytest.raises(InputError) as caught:
        closed(vertices, faces[1:])
    message = str(caught.value)
    assert "a.ply: the mesh is not closed: it has 3 boundary edges, one near (" in message
    assert "--repr soup" in message


def test_one_sided_surfaces_are_refused() -> None:
    """A Klein bottle, as a grid with one direction glued in reverse."""
    n, m = 12, 8
    index = np.arange(n * m).reshape(n, m)
    triangles = []
    for i in range(n):
        for j in range(m):
            i2, j2 = (i + 1) % n, (j + 1) % m
            a, b = index[i, j], index[i, j2]
            c, d = (index[i2, j], index[i2, j2]) if i + 1 < n else (index[0, -j % m], index[0, -j2 % m])
            triangles += [[a, c, b], [b, c, d]]
    with pytest.raises(InputError, match="one-sided"):
        closed(RNG.normal(size=(n * m, 3)), np.array(triangles))


@pytest.mark.parametrize("name", ["flat", "cancelled", "point", "huge", "tiny"])
def test_surfaces_without_volume_or_size_are_refused(name: str) -> None:
    vertices, faces = cube()
    if name == "cancelled":
        vertices, faces = together((vertices, faces), (vertices, faces[:, ::-1]))
    factor = {"flat": np.array([1, 1, 0]), "cancelled": 1.0, "point": 0.0, "huge": 1e100, "tiny": 1e-100}[name]
    with pytest.raises(InputError, match="encloses no volume|longest side"):
        closed(vertices * factor, faces)


@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e6), (1e-6, 1.0)])
def test_units_and_offsets_do_not_matter(scale: float, offset: float) -> None:
    vertices, faces = torus()
    mesh = closed(vertices * scale + offset, faces)
    np.testing.assert_array_equal(mesh.faces, faces)
    assert closed(*separate(vertices * scale + offset, faces)).faces.shape == faces.shape


def test_vertices_that_no_face_names_do_not_count() -> None:
    vertices, faces = cube()
    mesh = closed(np.concatenate([vertices, [[np.nan, np.inf, 1e300]]]), faces)
    assert len(mesh.vertices) == 8


def test_ten_vertices_are_enough() -> None:
    """Eight sides over a ring, two tips."""
    angle = 2 * np.pi * np.arange(8) / 8
    vertices = np.concatenate([np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), [[0, 0, 1], [0, 0, -1]]])
    faces = [[i, (i + 1) % 8, 8] for i in range(8)] + [[(i + 1) % 8, i, 9] for i in range(8)]
    assert len(closed(vertices, np.array(faces)).vertices) == 10


@pytest.mark.slow
def test_every_shared_mesh_is_taken_and_every_open_one_refused(shared_data: Path) -> None:
    """Components and Euler characteristics as the manifest of the data says."""
    from ndf_core.readers.mesh_file import read_mesh_file

    for row in (shared_data / "MANIFEST.md").read_text().splitlines():
        cells = [cell.strip() for cell in row.split("|")[1:-1]]
        if not cells or not cells[0].startswith(("mesh/", "soup/")) or "," in cells[0]:
            continue
        path = shared_data / cells[0]
        components, boundary, crowded, euler = (int(cells[i]) for i in (2, 3, 4, 5))
        raw = read_mesh_file(path)
        if boundary or crowded:
            with pytest.raises(InputError, match="boundary edges|more than two triangles"):
                closed_mesh(raw, None, path.name)
            continue
        mesh = closed_mesh(raw, None, path.name)
        counts = topology(mesh.faces, len(mesh.vertices))
        assert counts.closed, path.name
        assert counts.manifold, path.name
        assert counts.components == components, path.name
        if cells[6] == "yes":
            assert counts.euler_characteristic == euler, path.name
