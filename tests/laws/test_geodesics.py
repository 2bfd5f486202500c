"""Distances along surfaces: closed forms, metric laws, and independent implementations."""

from __future__ import annotations

import numpy as np
import potpourri3d as pp3d
import pytest
from flat_surfaces import FlatTorus, pillow, pillow_distances, rough_sphere
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation
from small_assets import icosphere, open_grid, torus

from ndf_core.errors import InputError
from ndf_core.kernels.delaunay import straight_lengths
from ndf_core.kernels.variation import vary_distances
from ndf_core.processing.exact_geodesics import _detour, exact_distances
from ndf_core.processing.face_curvature import face_curvature
from ndf_core.processing.geodesics import geodesic_distances
from ndf_core.processing.heat_method import heat_distances
from ndf_core.processing.insertion import insert_points
from ndf_core.processing.operators import Operators
from ndf_core.processing.surface_points import SurfacePoints

POINT = np.array([[0.3, 0.4, np.sqrt(0.75)]])


def mean_error(found: Float[Array, " v"], true: Float[Array, " v"]) -> float:
    return float(np.abs(found - true).sum() / true.sum())


def at_vertices(operators: Operators, *vertices: int) -> SurfacePoints:
    faces = [int(np.flatnonzero((operators.faces == vertex).any(axis=1))[0]) for vertex in vertices]
    weights = (operators.faces[faces] == np.array(vertices)[:, None]).astype(np.float64)
    return SurfacePoints(np.array(faces), weights, operators.vertices[list(vertices)], np.zeros(len(vertices)))


@pytest.mark.parametrize(("method", "ratio"), [("exact", 4**1.9), ("heat", 1.5)])
def test_distances_on_the_sphere_converge(method, ratio: float) -> None:
    """The exact method's with the square of the edge length, the heat method's slowly."""
    errors = []
    for subdivisions in (2, 4):
        operators = Operators(*icosphere(subdivisions))
        found = geodesic_distances(operators, POINT, method).distances
        errors.append(mean_error(found, np.arccos(np.clip(operators.vertices @ POINT[0], -1, 1))))
    assert errors[1] < 5e-3
    assert errors[0] / errors[1] > ratio


def test_exact_distances_on_the_pillow_are_exact() -> None:
    """Flat but for its corners, so that the triangles' own distances are known; from a point inside a face."""
    operators = Operators(*pillow(8))
    source = np.array([[0.31, 0.64, 0.0]])
    found = operators.closest(source)
    front = found._replace(faces=found.faces % (len(operators.faces) // 2))  # the back is at the same place
    distances, missed = exact_distances(operators, front)
    np.testing.assert_allclose(distances, pillow_distances(operators.vertices, 8, source[0, :2]), atol=1e-12)
    assert missed == 0


def test_heat_distances_on_the_flat_torus_converge() -> None:
    errors = []
    for side in (16, 64):
        torus_ = FlatTorus(side)
        errors.append(mean_error(heat_distances(torus_, at_vertices(torus_, 5)), torus_.distances(5)))
    assert errors[1] < 0.02
    assert errors[1] < errors[0] / 1.8


def test_heat_is_near_exact_on_curved_shapes() -> None:
    """Worst on the torus, where distances have long ridges: smoothing fills them."""
    for mesh, limit in ((torus(96, 48), 0.04), (icosphere(3), 0.02), (rough_sphere(2000), 0.02)):
        operators = Operators(*mesh)
        exact = geodesic_distances(operators, POINT, "exact").distances
        assert mean_error(geodesic_distances(operators, POINT, "heat").distances, exact) < limit


@pytest.mark.parametrize("sources", [[7], [7, 40, 500]])
def test_heat_equals_potpourri3d(sources: list[int]) -> None:
    """The same method by other code, up to its constant: potpourri3d sets the least value to zero."""
    vertices, faces = rough_sphere(1000)
    theirs = pp3d.MeshHeatMethodDistanceSolver(vertices, faces, use_robust=True).compute_distance_multisource(sources)
    operators = Operators(vertices, faces)
    ours = heat_distances(operators, at_vertices(operators, *sources))
    difference = (ours - theirs)[ours > 0.05]
    assert np.ptp(difference) < 1e-3 * theirs.max()
    assert np.abs(difference).max() < 0.02 * theirs.max()


def test_exact_distances_are_a_metric_below_paths_along_edges() -> None:
    vertices, faces = rough_sphere(120, seed=3)
    operators = Operators(vertices, faces)
    chosen = [0, 17, 55, 90]
    rows = np.stack([exact_distances(operators, at_vertices(operators, vertex))[0] for vertex in chosen])
    between = rows[:, chosen]
    np.testing.assert_allclose(between, between.T, atol=1e-12)
    assert (rows <= between[:, :, None] + rows[None] + 1e-12).all(), "triangle inequality, every vertex"
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    edge = np.linalg.norm(vertices[start] - vertices[end], axis=1)
    graph = coo_array((edge, (start, end)), shape=(len(vertices),) * 2)
    along_edges = dijkstra(graph, indices=chosen)
    assert (rows <= along_edges + 1e-12).all()
    assert (rows >= np.linalg.norm(vertices[chosen][:, None] - vertices, axis=2) - 1e-12).all()
    assert (rows < along_edges - 1e-3).mean() > 0.5


@pytest.mark.parametrize("method", ["exact", "heat"])
def test_rigid_motion_and_scale(method) -> None:
    vertices, faces = rough_sphere(200)
    turn = Rotation.from_euler("xyz", [1.0, 2.0, 3.0]).as_matrix()
    one = geodesic_distances(Operators(vertices, faces), POINT, method).distances
    moved = Operators(1e3 * vertices @ turn.T + [5.0, 6.0, 7.0], faces)
    two = geodesic_distances(moved, 1e3 * POINT @ turn.T + [5.0, 6.0, 7.0], method).distances
    np.testing.assert_allclose(two, 1e3 * one, atol=1e-6)


@pytest.mark.parametrize(("method", "tolerance"), [("exact", 1e-12), ("heat", 0.15)])
def test_several_sources_give_the_nearest(method, tolerance: float) -> None:
    operators = Operators(*icosphere(3))
    points = np.concatenate([POINT, [[-1.0, 0.0, 0.0]]])
    together = geodesic_distances(operators, points, method)
    single = [geodesic_distances(operators, points[i : i + 1], method).distances for i in (0, 1)]
    np.testing.assert_allclose(together.distances, np.minimum(*single), atol=tolerance)
    assert together.unreached_components == 0
    assert together.distances.min() < 0.05


@pytest.mark.parametrize("method", ["exact", "heat"])
def test_components_without_a_source_are_infinitely_far(method) -> None:
    vertices, faces = icosphere(2)
    count = len(vertices)
    operators = Operators(
        np.concatenate([vertices, vertices + 4, vertices - 4]),
        np.concatenate([faces, faces + count, faces + 2 * count]),
    )
    found = geodesic_distances(operators, np.array([[0.0, 0.0, 2.0]]), method)
    assert np.isfinite(found.distances[:count]).all()
    assert np.isinf(found.distances[count:]).all()
    assert found.unreached_components == 2
    assert found.approximated == 0
    assert found.sources.offsets[0] == pytest.approx(1.0)
    both = geodesic_distances(operators, np.array([[0.0, 0.0, 2.0], [4.0, 4.0, 6.0]]), method)
    np.testing.assert_allclose(both.distances[count : 2 * count], both.distances[:count], atol=1e-9)


@pytest.mark.parametrize("method", ["exact", "heat"])
def test_a_border_is_no_obstacle(method) -> None:
    vertices, faces = open_grid(6)
    found = geodesic_distances(Operators(vertices * [1, 1, 0], faces), np.zeros((1, 3)), method).distances
    straight = np.linalg.norm(vertices[:, :2], axis=1)
    assert (found >= straight - (1e-12 if method == "exact" else 0.15)).all()
    assert found[np.argmax(straight)] > straight.max(), "around the hole"


def test_inserted_points_leave_the_surface_as_it_is() -> None:
    vertices, faces = icosphere(1)
    operators = Operators(vertices, faces)
    a, b, c = vertices[faces[3]]
    wanted = [
        (a + b + c) / 3,
        0.2 * a + 0.3 * b + 0.5 * c,
        0.5 * (a + b),
        0.25 * (a + b) + 0.5 * c,
        b,
        0.7 * a + 0.3 * b,
    ]
    points = operators.closest(np.array(wanted))
    new_vertices, new_faces, made = insert_points(vertices, faces, points)
    np.testing.assert_allclose(new_vertices[made], wanted, atol=1e-12)
    assert made[4] == faces[3, 1]
    assert len(new_vertices) == len(vertices) + 5
    split = Operators(new_vertices, new_faces)
    assert split.area == pytest.approx(operators.area, rel=1e-12)
    np.testing.assert_allclose(split.closest(new_vertices).offsets, 0, atol=1e-12)
    assert len(new_faces) - len(faces) == 2 * 5, "closed as before"
    _ = split.triangulation


def test_missed_vertices_get_the_way_over_a_neighbour() -> None:
    vertices, faces = icosphere(1)
    true = np.arccos(np.clip(vertices @ vertices[0], -1, 1))
    missed = np.zeros(len(vertices), dtype=bool)
    missed[[5, 20]] = True
    distances = np.where(missed, np.inf, true)
    _detour(vertices, faces, distances, missed)
    edge = np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2).max()
    assert (distances[missed] >= true[missed] - 0.05).all()
    assert (distances[missed] <= true[missed] + 2 * edge).all()
    np.testing.assert_array_equal(distances[~missed], true[~missed])


@pytest.mark.parametrize(
    ("points", "message"), [(np.zeros((0, 3)), "at least one source"), (np.full((1, 3), np.nan), "not finite")]
)
def test_sources_that_are_none_are_refused(points: Array, message: str) -> None:
    with pytest.raises(InputError, match=message):
        geodesic_distances(Operators(*icosphere(1)), points)


def test_distances_scale_with_the_edge_lengths() -> None:
    """A path of every vertex is known to first order: where all lengths grow by a share, so do all distances."""
    vertices, faces = torus()
    operators = Operators(vertices, faces)
    flat = exact_distances(operators, operators.closest(vertices[[7, 44]]))[0]
    known, lengths = np.where(flat == 0, 0.0, np.nan), straight_lengths(vertices, faces)
    found = flat + vary_distances(faces, lengths, 1.001 * lengths, flat, known)
    np.testing.assert_allclose(found, 1.001 * flat, rtol=1e-9)


def test_lengths_of_arcs_bring_distances_closer_to_the_sphere() -> None:
    vertices, faces = icosphere(3)
    arcs = 2 * np.arcsin(straight_lengths(vertices, faces) / 2)
    true = np.arccos(np.clip(vertices @ POINT[0], -1, 1))
    flat = geodesic_distances(Operators(vertices, faces), POINT, "exact").distances
    curved = geodesic_distances(Operators(vertices, faces, edge_lengths=arcs), POINT, "exact").distances
    assert mean_error(curved, true) < 0.08 * mean_error(flat, true)


def test_faces_of_a_sphere_are_curved_and_those_of_a_polyhedron_flat() -> None:
    errors: list[float] = []
    for level in (2, 3):
        vertices, faces = icosphere(level)
        found = face_curvature(vertices, faces, 2 * np.arcsin(straight_lengths(vertices, faces) / 2))
        assert (found > 0).all() and (found < 1).all()
        errors.append(float(1 - found.mean()))
    assert errors[1] < 0.3 * errors[0] < 0.01
    assert not face_curvature(*icosphere(2), straight_lengths(*icosphere(2))).any()


def test_curvature_of_a_torus_has_its_sign_and_size() -> None:
    vertices, faces = torus(60, 30)
    chords = straight_lengths(vertices, faces)
    middles = 0.5 * (vertices[faces] + vertices[np.roll(faces, -1, axis=1)])
    arcs = chords + 8 / 3 * np.linalg.norm(onto_torus(middles) - middles, axis=2) ** 2 / chords
    found = face_curvature(vertices, faces, arcs)
    centres = onto_torus(vertices[faces].mean(axis=1))
    radius = np.linalg.norm(centres[:, :2], axis=1)
    true = (radius - 1) / 0.4**2 / radius
    curved = np.abs(true) > 0.5
    assert (found * true > 0)[curved].mean() > 0.99
    assert 0.85 < np.median((found / true)[curved]) < 1.05


def onto_torus(points: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """The closest points of the torus of radii 1 and 0.4."""
    middle = points * [1, 1, 0]
    middle = middle / np.linalg.norm(middle, axis=-1, keepdims=True)
    return middle + 0.4 * (points - middle) / np.linalg.norm(points - middle, axis=-1, keepdims=True)


def test_distances_between_vertices_follow_curved_fronts() -> None:
    vertices, faces = icosphere(3)
    arcs = 2 * np.arcsin(straight_lengths(vertices, faces) / 2)
    operators = Operators(vertices, faces, edge_lengths=arcs)
    points = operators.closest(icosphere(5)[0])
    true = np.arccos(np.clip(icosphere(5)[0] @ POINT[0], -1, 1))
    for method, share in (("exact", 0.5), ("heat", 1.0)):
        found = geodesic_distances(operators, POINT, method)
        linear = operators.interpolate(found.distances, points)
        assert mean_error(found.at(points), true) < share * mean_error(linear, true)


def test_distances_are_zero_at_sources_and_infinite_on_other_components() -> None:
    vertices, faces = icosphere(2)
    two = Operators(np.concatenate([vertices, vertices + 5]), np.concatenate([faces, faces + len(vertices)]))
    inside = vertices[faces[[3, 40]]].mean(axis=1)
    found = geodesic_distances(two, inside, "exact")
    np.testing.assert_allclose(found.at(two.closest(inside)), 0, atol=1e-7)
    assert np.isinf(found.at(two.closest(inside + 5))).all()


def test_faulty_variations_are_refused() -> None:
    _, faces = icosphere(0)
    lengths, distances = np.ones((20, 3)), np.zeros(12)
    with pytest.raises(IndexError, match=r"faces: index 12 is outside \[0, 12\)"):
        vary_distances(np.where(faces == 3, 12, faces), lengths, lengths, distances, distances)
    with pytest.raises(ValueError, match="two lengths per side"):
        vary_distances(faces, lengths, lengths[1:], distances, distances)
