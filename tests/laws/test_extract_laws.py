"""Laws of extraction: topology of the base mesh, no long edge, vertices on the field, repeatable."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray as Array
from small_assets import icosphere, open_grid, small_content, torus
from solids import box, min_angles

from ndf_core.asset.asset import Asset
from ndf_core.asset.content import AssetContent, QuantisedArray
from ndf_core.errors import ExtractionError
from ndf_core.extract import remeshing
from ndf_core.extract.extract import extract_mesh, refine_mesh
from ndf_core.extract.extracted import ExtractedMesh
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.delaunay import straight_lengths
from ndf_core.mesh import face_normals, topology
from ndf_core.processing.operators import Operators

MESHES = {"sphere": icosphere(1), "torus": torus(), "open": open_grid()}


def content_of(mesh: str, amplitude: float = 0.05, scale: float = 0.4) -> AssetContent:
    return small_content(MESHES[mesh], amplitude=amplitude, center=(5.0, -7.0, 2.0), scale=scale)


def longest_edge(mesh: ExtractedMesh) -> float:
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max())


def area(vertices: Float[Array, "v 3"], faces: Array) -> float:
    return float(np.linalg.norm(face_normals(vertices, faces), axis=1).sum() / 2)


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("edge_length", [None, 0.04, 0.3])
def test_topology_edge_length_and_field(mesh: str, edge_length: float | None) -> None:
    asset = Asset(content_of(mesh))
    extracted = asset.extract(edge_length)
    base = topology(asset.content.faces, len(asset.content.vertices))
    ours = topology(extracted.faces, len(extracted.vertices))
    assert ours.manifold
    assert ours.closed == base.closed == (mesh != "open")
    assert ours.euler_characteristic == base.euler_characteristic
    assert ours.components == base.components
    assert extracted.edge_length == (asset.default_edge_length if edge_length is None else edge_length)
    assert longest_edge(extracted) <= extracted.edge_length * (1 + 1e-12)
    np.testing.assert_array_equal(extracted.vertices, asset.map_points(extracted.base_faces, extracted.barycentric))
    assert (extracted.barycentric >= 0).all()
    np.testing.assert_allclose(extracted.barycentric.sum(axis=1), 1.0, rtol=0, atol=4e-16)
    statistics = extracted.statistics
    assert statistics["manifold"]
    assert statistics["closed"] == base.closed
    least = 0.98 if extracted.edge_length < 0.05 else 0.85  # few faces, sharp edges between them
    assert least < statistics["delaunay_extrinsic"] <= statistics["delaunay"] == 1
    assert statistics["unsplit_edges"] == 0
    assert statistics["folded_area"] == 0
    stages = {"map", "split", "flip", "remove", "move", "sort", "measure", "delaunay", "check", "total"}
    assert set(statistics["seconds"]) == stages


@pytest.mark.parametrize("mesh", MESHES)
def test_identity_reproduces_the_base_surface(mesh: str) -> None:
    """With a zero network the mesh lies on the base mesh. It cuts edges off, by no more than a face."""
    asset = Asset(content_of(mesh, amplitude=0.0))
    vertices = asset.to_input(asset.content.vertices)
    extracted = asset.extract(0.02)
    assert area(extracted.vertices, extracted.faces) == pytest.approx(area(vertices, asset.content.faces), rel=0.01)
    distances = TriangleBVH(vertices, asset.content.faces).closest(extracted.vertices)[0] - extracted.vertices
    assert np.linalg.norm(distances, axis=1).max() < 1e-6
    kept = TriangleBVH(extracted.vertices, extracted.faces).closest(vertices)[0]
    np.testing.assert_allclose(kept, vertices, rtol=0, atol=1e-6)  # the corners of the base mesh
    assert extracted.statistics["folded_area"] == 0


def box_points(content: AssetContent) -> Float[Array, "n 3"]:
    """Points along the sharp edges: those between faces at right angles."""
    corners = content.vertices * content.scale + content.center
    ends = [(p, q) for p in corners for q in corners if np.count_nonzero(np.abs(p - q) > 1e-9) == 1]
    return np.concatenate([p + np.linspace(0, 1, 50)[:, None] * (q - p) for p, q in ends])


@pytest.mark.parametrize("edge_length", [0.5, 0.21, 0.1])
def test_sharp_edges_of_a_box_stay_sharp(edge_length: float) -> None:
    """Its twelve edges are edges of the base mesh: hardly a flip cuts them off, vertices slide along them only."""
    content = small_content(box((1.0, 0.6, 0.8)), amplitude=0.0)
    extracted = Asset(content).extract(edge_length)
    expected = area(Asset(content).to_input(content.vertices), content.faces)
    assert area(extracted.vertices, extracted.faces) == pytest.approx(expected, rel=2e-3)
    distances = TriangleBVH(extracted.vertices, extracted.faces).closest(box_points(content))[0] - box_points(content)
    assert np.mean(np.linalg.norm(distances, axis=1) < 1e-6) > 0.8
    assert np.percentile(min_angles(extracted.vertices, extracted.faces), 1) > 20


@pytest.mark.parametrize("mesh", MESHES)
def test_huge_edge_length_gives_the_base_vertices_mapped(mesh: str) -> None:
    asset = Asset(content_of(mesh))
    extracted = asset.extract(1e9)
    faces = asset.content.faces
    corner = np.array([np.argwhere(faces == v)[0] for v in range(len(asset.content.vertices))])
    mapped = asset.map_points(corner[:, 0].astype(np.int32), np.eye(3)[corner[:, 1]])
    assert len(extracted.faces) == len(faces)
    order, expected = np.lexsort(extracted.vertices.T.round(9)), np.lexsort(mapped.T.round(9))
    np.testing.assert_allclose(extracted.vertices[order], mapped[expected], rtol=0, atol=1e-6 * asset.longest_side)


@pytest.mark.parametrize("mesh", MESHES)
def test_faces_are_well_shaped(mesh: str) -> None:
    extracted = Asset(content_of(mesh)).extract(0.03)
    angles = min_angles(extracted.vertices, extracted.faces)
    assert np.percentile(angles, 1) > 20
    assert np.median(angles) > 42


def test_repeatable_for_any_number_of_threads() -> None:
    content = small_content(icosphere(2), width=32)
    one, two, three = (extract_mesh(content, 0.03, threads) for threads in (1, 2, 3))
    assert len(one.vertices) > 20_000  # enough rows for every thread
    for other in (two, three):
        for name in ("vertices", "faces", "base_faces", "barycentric"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_scale_and_place_of_the_input_do_not_matter() -> None:
    near = extract_mesh(small_content(torus()), 0.1)
    far = extract_mesh(small_content(torus(), center=(1e6, -1e6, 3.0), scale=1e-6), 0.1e-6)
    np.testing.assert_array_equal(near.faces, far.faces)
    np.testing.assert_allclose((far.vertices - np.array([1e6, -1e6, 3.0])) / 1e-6, near.vertices, atol=1e-3)


def test_refining_goes_on_from_the_stage_before() -> None:
    asset = Asset(content_of("torus"))
    lengths = [0.5, 0.1, 0.1, 0.03]
    stages = list(asset.refine(lengths))
    assert [stage.edge_length for stage in stages] == lengths
    for stage, finer in itertools.pairwise(stages):
        assert topology(finer.faces, len(finer.vertices)).manifold
        assert longest_edge(finer) <= finer.edge_length * (1 + 1e-12)
        np.testing.assert_array_equal(finer.vertices, asset.map_points(finer.base_faces, finer.barycentric))
        assert len(stage.faces) <= len(finer.faces)
    direct = asset.extract(0.03)
    assert len(stages[3].vertices) == pytest.approx(len(direct.vertices), rel=0.1)
    one, two = (np.median(min_angles(mesh.vertices, mesh.faces)) for mesh in (stages[3], direct))
    assert abs(one - two) < 3


def test_coarser_stage_is_refused() -> None:
    stages = refine_mesh(content_of("sphere"), [0.2, 0.3])
    next(stages)
    with pytest.raises(ExtractionError, match=r"0\.3 is larger than the one before, 0\.2"):
        next(stages)


@pytest.mark.parametrize("edge_length", [0.0, -1.0, float("nan"), float("inf")])
def test_edge_lengths_that_are_not_positive(edge_length: float) -> None:
    with pytest.raises(ExtractionError, match="not a positive number"):
        extract_mesh(content_of("sphere"), edge_length)


def test_too_fine_is_refused_at_once_with_a_length_that_works(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ExtractionError, match="more than 20000000 vertices; the smallest possible is about"):
        extract_mesh(content_of("sphere"), 1e-12)
    monkeypatch.setattr(remeshing, "MAX_VERTICES", 10_000)
    content = content_of("sphere")
    with pytest.raises(ExtractionError, match="smallest possible") as caught:
        extract_mesh(content, 0.001)
    smallest = float(str(caught.value).split()[-1])
    assert len(extract_mesh(content, smallest).vertices) <= 10_000
    with pytest.raises(ExtractionError, match="smallest possible"):
        extract_mesh(content, smallest / 2)


def with_displacement(content: AssetContent, step: float) -> AssetContent:
    """The same codes with another step for the last layer."""
    block = content.fields["displacement"]
    last = block.weights[-1]
    assert isinstance(last, QuantisedArray)
    weights = (*block.weights[:-1], QuantisedArray(last.codes, step))
    return dataclasses.replace(
        content, fields={**content.fields, "displacement": dataclasses.replace(block, weights=weights)}
    )


def test_a_field_that_is_not_finite_is_refused() -> None:
    content = content_of("sphere")
    block = content.fields["displacement"]
    first = block.weights[1]
    assert isinstance(first, QuantisedArray)
    weights = (block.weights[0], QuantisedArray(first.codes, 1e30), block.weights[2])
    content = dataclasses.replace(content, fields={"displacement": dataclasses.replace(block, weights=weights)})
    with pytest.raises(ExtractionError, match="not finite|vertices"):
        extract_mesh(with_displacement(content, 1e30))


def test_a_rough_field_is_followed_to_the_end() -> None:
    """Untrained weights on eight levels: the surface folds so much that edges with near ends miss what is between."""
    extracted = extract_mesh(small_content(icosphere(0), levels=8, width=16, amplitude=0.02), 0.06)
    assert longest_edge(extracted) <= 0.06 * (1 + 1e-12)
    assert extracted.statistics["euler_characteristic"] == 2
    assert extracted.statistics["manifold"]


def test_a_field_of_large_stretch_is_followed_to_the_end() -> None:
    """Forty to one in places, as fits have them: flips that serve the mapped mesh bring back what splits removed."""
    extracted = extract_mesh(small_content(icosphere(0), levels=8, width=16, amplitude=0.06), 0.06)
    assert longest_edge(extracted) <= 0.06 * (1 + 1e-12)
    assert extracted.statistics["unsplit_edges"] == 0
    assert extracted.statistics["manifold"]


def test_blunt_creases_are_not_cut_off() -> None:
    """Faces of an icosphere meet at 18 degrees: flips and moves would lose area, and gain angles, at every edge."""
    content = small_content(icosphere(1), amplitude=0.0)
    extracted = Asset(content).extract(0.05)
    expected = area(Asset(content).to_input(content.vertices), content.faces)
    assert area(extracted.vertices, extracted.faces) == pytest.approx(expected, rel=2e-4)


def test_edges_are_measured_along_the_surface() -> None:
    """No shorter than straight, as long on both sides, and together with more area: what the flat faces cut off."""
    extracted = Asset(content_of("torus")).extract(0.1)
    straight = straight_lengths(extracted.vertices, extracted.faces)
    assert (extracted.edge_lengths >= straight * (1 - 1e-12)).all()
    assert (extracted.edge_lengths <= straight * (1.15 + 1e-12)).all()
    finer = Asset(content_of("torus")).extract(0.02)
    true = Operators.of(finer).area
    flat = area(extracted.vertices, extracted.faces)
    assert abs(Operators.of(extracted).area - true) < 0.5 * abs(flat - true)


def test_edges_that_are_not_measured_are_straight() -> None:
    """The same mesh otherwise, and still with a Delaunay triangulation of its own."""
    asset = Asset(content_of("torus"))
    measured, flat = asset.extract(0.1), asset.extract(0.1, measure_edges=False)
    assert np.array_equal(flat.vertices, measured.vertices) and np.array_equal(flat.faces, measured.faces)
    assert np.array_equal(flat.edge_lengths, straight_lengths(flat.vertices, flat.faces))
    assert not np.array_equal(flat.edge_lengths, measured.edge_lengths)
    assert flat.statistics["delaunay"] == 1


def test_a_wildly_rough_field_ends_with_an_error() -> None:
    with pytest.raises(ExtractionError, match="vertices|rough"):
        extract_mesh(with_displacement(content_of("sphere"), 1e20))


def test_a_base_mesh_that_is_not_manifold_is_refused() -> None:
    content = content_of("sphere")
    faces = np.concatenate([content.faces, content.faces[:1]])
    with pytest.raises(ExtractionError, match="not an oriented manifold: 3 edges of more than two faces"):
        extract_mesh(dataclasses.replace(content, faces=faces), 0.1)
    turned = content.faces.copy()
    turned[0] = turned[0, ::-1]
    with pytest.raises(ExtractionError, match="3 of two that disagree"):
        extract_mesh(dataclasses.replace(content, faces=turned), 0.1)


def test_unused_base_vertices_are_left_out() -> None:
    content = content_of("sphere")
    faces = content.faces[~(content.faces == 3).any(axis=1)]
    extracted = extract_mesh(dataclasses.replace(content, faces=faces), 1e9)
    assert len(extracted.vertices) == len(content.vertices) - 1
    assert extracted.statistics["manifold"]
    assert not extracted.statistics["closed"]


def test_values_come_back_to_points_of_the_surface() -> None:
    """A linear function of space, given at the vertices, is itself again at points on or near the mesh."""
    asset = Asset(content_of("torus"))
    mesh = asset.extract(0.05)
    values = mesh.vertices @ np.array([[1.0, -2.0], [0.5, 3.0], [2.0, 0.0]]) + 1.0
    rng = np.random.default_rng(0)
    corners = mesh.vertices[mesh.faces[rng.integers(0, len(mesh.faces), 5000)]]
    points = np.einsum("nk,nkc->nc", rng.dirichlet(np.ones(3), 5000), corners)
    expected = points @ np.array([[1.0, -2.0], [0.5, 3.0], [2.0, 0.0]]) + 1.0
    np.testing.assert_allclose(mesh.interpolate(values, points), expected, atol=1e-12)
    np.testing.assert_allclose(mesh.interpolate(values[:, 0], points, threads=2), expected[:, 0], atol=1e-12)
    np.testing.assert_array_equal(mesh.interpolate(values, mesh.vertices), values)
    faces, weights, distances = mesh.locate(points)
    np.testing.assert_allclose(np.einsum("nk,nkc->nc", weights, mesh.vertices[mesh.faces[faces]]), points, atol=1e-12)
    assert distances.max() < 1e-12
    # Points of the field itself, which the mesh only comes close to.
    base_faces = rng.integers(0, len(asset.content.faces), 2000).astype(np.int32)
    exact = asset.map_points(base_faces, rng.dirichlet(np.ones(3), 2000))
    assert mesh.locate(exact)[2].max() < 0.3 * mesh.edge_length  # beside a sharp edge
    with pytest.raises(ValueError, match=r"values: need \d+ rows, one per vertex, got 3"):
        mesh.interpolate(values[:3], points)


def test_self_intersections_are_counted() -> None:
    mesh = Asset(content_of("sphere")).extract(0.1)
    assert mesh.self_intersections == 0
    center = np.array([5.0, -7.0, 2.0])
    pushed = mesh.vertices.copy()
    pushed[0] = center - 1.5 * (pushed[0] - center)  # through the other side
    assert dataclasses.replace(mesh, vertices=pushed).self_intersections > 0
