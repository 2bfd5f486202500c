"""Laws of the Laplacian, the mass matrices and the gradient, on good meshes and on bad ones."""

from __future__ import annotations

import igl
import numpy as np
import pytest
import robust_laplacian
from flat_surfaces import FlatTorus, Mesh, pillow, rough_sphere, spindle
from scipy.spatial.transform import Rotation
from small_assets import icosphere, open_grid, small_content, torus

from ndf_core.asset.asset import Asset
from ndf_core.errors import InputError
from ndf_core.processing.cholesky import Cholesky
from ndf_core.processing.operators import Operators
from ndf_core.processing.triangles import areas, mollified

MESHES = {
    "sphere": icosphere(2),
    "torus": torus(),
    "border": open_grid(5),
    "pillow": pillow(6),
    "rough": rough_sphere(),
    "needles": rough_sphere(squeeze=1e-5),
    "valence 500": spindle(),
}


@pytest.fixture(params=list(MESHES))
def mesh(request: pytest.FixtureRequest) -> Mesh:
    return MESHES[request.param]


def test_laplacian_is_positive_semidefinite_with_constants_as_kernel(mesh: Mesh) -> None:
    laplacian = Operators(*mesh).laplacian.toarray()
    size = np.abs(laplacian).max()
    np.testing.assert_array_equal(laplacian, laplacian.T)
    assert np.abs(laplacian.sum(axis=1)).max() <= 1e-12 * size
    values = np.linalg.eigvalsh(laplacian)
    assert values[0] > -1e-12 * size
    assert values[1] > 1e-9 * values[-1] or size > 1e4, "one component, one constant"


def test_no_weight_is_negative(mesh: Mesh) -> None:
    """The maximum principle, which the cotangents of the mesh's own edges do not have."""
    laplacian = Operators(*mesh).laplacian.toarray()
    off = laplacian - np.diag(np.diag(laplacian))
    assert off.max() <= 1e-9 * np.abs(laplacian).max()


def test_the_mesh_itself_has_negative_weights_where_it_is_rough() -> None:
    vertices, faces = MESHES["needles"]
    own = igl.cotmatrix(vertices, faces.astype(np.int64)).toarray()  # negative semidefinite: weights have their sign
    assert (own - np.diag(np.diag(own))).min() < -1


def test_masses_sum_to_the_area(mesh: Mesh) -> None:
    vertices, faces = mesh
    operators = Operators(vertices, faces)
    corner = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum()
    assert operators.area == pytest.approx(area, rel=1e-9)
    for kind in ("lumped", "galerkin", "mean"):
        assert operators.mass(kind).sum() == pytest.approx(area, rel=1e-9)
    np.testing.assert_allclose(operators.galerkin_mass.sum(axis=1), operators.lumped_mass, rtol=1e-9)


def test_gradient_and_laplacian_agree(mesh: Mesh) -> None:
    operators = Operators(*mesh)
    gradient, weight = operators.gradient, np.repeat(operators.areas, 2)
    energy = (gradient.T @ (weight[:, None] * gradient.toarray())) - operators.laplacian.toarray()
    assert np.abs(energy).max() <= 1e-8 * np.abs(operators.laplacian).max()


def test_dirichlet_energy_of_linear_functions_in_the_plane() -> None:
    vertices, faces = open_grid(6)
    vertices = vertices * [1.0, 1.0, 0.0]
    operators = Operators(vertices, faces)
    values = vertices @ [2.0, -3.0, 0.0]
    assert values @ (operators.laplacian @ values) == pytest.approx(13 * operators.area)
    slopes = (operators.gradient @ values).reshape(-1, 2)
    np.testing.assert_allclose(np.linalg.norm(slopes, axis=1), np.sqrt(13))


def test_rigid_motion_changes_nothing(mesh: Mesh) -> None:
    vertices, faces = mesh
    moved = vertices @ Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix().T + [0.3, -0.2, 0.7]
    one, two = Operators(vertices, faces), Operators(moved, faces)
    size = np.abs(one.laplacian).max()
    # Heights of needles are differences of rounded coordinates.
    thinnest = (2 * one.areas / one.lengths.max(axis=1)).min() / one.lengths.max()
    assert np.abs(one.laplacian - two.laplacian).max() <= max(1e-13 / thinnest**2, 1e-11) * size
    np.testing.assert_allclose(one.lumped_mass, two.lumped_mass, rtol=max(1e-13 / thinnest**2, 1e-11))


def test_scaling() -> None:
    vertices, faces = MESHES["rough"]
    one, two = Operators(vertices, faces), Operators(1e6 * vertices, faces)
    assert np.abs(one.laplacian - two.laplacian).max() <= 1e-10 * np.abs(one.laplacian).max()
    np.testing.assert_allclose(1e12 * one.lumped_mass, two.lumped_mass, rtol=1e-10)


def test_equals_libigl_on_a_delaunay_mesh() -> None:
    vertices, faces = icosphere(3)
    operators = Operators(vertices, faces)
    wide = faces.astype(np.int64)
    assert abs(operators.laplacian + igl.cotmatrix(vertices, wide)).max() < 1e-12
    lumped = igl.massmatrix(vertices, wide, igl.MASSMATRIX_TYPE_BARYCENTRIC)
    np.testing.assert_allclose(operators.lumped_mass, lumped.diagonal(), rtol=1e-12)
    assert abs(operators.galerkin_mass - igl.massmatrix(vertices, wide, igl.MASSMATRIX_TYPE_FULL)).max() < 1e-15


@pytest.mark.parametrize("name", ["rough", "torus", "valence 500"])
def test_equals_robust_laplacian(name: str) -> None:
    """Another implementation of intrinsic Delaunay Laplacians, for meshes that are not Delaunay."""
    vertices, faces = MESHES[name]
    operators = Operators(vertices, faces)
    laplacian, mass = robust_laplacian.mesh_laplacian(vertices, faces, mollify_factor=0.0)
    assert abs(operators.laplacian - laplacian).max() <= 1e-8 * abs(laplacian).max()
    np.testing.assert_allclose(operators.lumped_mass, mass.diagonal(), rtol=1e-8)


def test_poisson_solves_on_every_component() -> None:
    vertices, faces = icosphere(2)
    operators = Operators(np.concatenate([vertices, vertices + 5]), np.concatenate([faces, faces + len(vertices)]))
    assert operators.components.max() == 1
    right = operators.lumped_mass * operators.vertices[:, 2]
    for part in (0, 1):
        right[operators.components == part] -= right[operators.components == part].mean()
    solution = operators.poisson.solve(right)
    np.testing.assert_allclose(operators.laplacian @ solution, right, atol=1e-12)
    two = operators.poisson.solve(np.stack([right, 2 * right], axis=1))
    np.testing.assert_allclose(two, solution[:, None] * [1, 2], atol=1e-12)


def test_an_extracted_mesh_has_operators() -> None:
    mesh = Asset(small_content(torus(), amplitude=0.01)).extract()
    operators = Operators.of(mesh)
    assert operators.vertices.shape == mesh.vertices.shape
    again = Operators(mesh.vertices, mesh.faces, edge_lengths=mesh.edge_lengths)
    assert abs(operators.laplacian - again.laplacian).max() < 1e-9


def test_interpolation_is_linear_and_closest_points_are_on_the_mesh() -> None:
    vertices, faces = MESHES["rough"]
    operators = Operators(vertices, faces)
    queries = np.random.default_rng(1).normal(size=(50, 3))
    found = operators.closest(queries)
    np.testing.assert_allclose(operators.interpolate(vertices, found), found.positions, atol=1e-14)
    np.testing.assert_allclose(operators.interpolate(vertices[:, 0], found), found.positions[:, 0], atol=1e-14)
    np.testing.assert_allclose(found.offsets, np.linalg.norm(queries - found.positions, axis=1))


def test_triangles_without_area_are_mollified_and_others_left_alone() -> None:
    good = Operators(*icosphere(1)).triangulation.lengths
    assert mollified(good) is good
    flat = np.array([[2.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    assert areas(flat)[0] == 0
    assert areas(mollified(flat))[0] > 0
    assert np.abs(mollified(flat) - flat).max() < 1e-7


def test_degenerate_triangles_of_a_mesh_do_no_harm() -> None:
    """A vertex in the middle of an edge: the triangle along the edge has no area."""
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.5, 1, 0], [0.5, -1, 0]])
    faces = np.array([[0, 1, 3], [1, 0, 2], [0, 4, 2], [2, 4, 1]], dtype=np.int32)
    laplacian = Operators(vertices, faces).laplacian.toarray()
    assert np.isfinite(laplacian).all()
    assert np.linalg.eigvalsh(laplacian)[0] > -1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v, f: (v, f[:0]), "no triangles"),
        (lambda v, f: (np.concatenate([v, v[:1]]), f), "belong to no face"),
        (lambda v, f: (v[:-1], f), "names a vertex outside"),
        (lambda v, f: (v, -f), "names a vertex outside"),
    ],
)
def test_meshes_that_are_none_are_refused(change, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Operators(*change(*icosphere(1)))


def test_faults_of_the_mesh_are_said_when_it_is_first_computed_on() -> None:
    vertices, faces = icosphere(1)
    with pytest.raises(InputError, match="not an oriented manifold"):
        _ = Operators(vertices, np.concatenate([faces, faces[:1]])).laplacian
    broken = vertices.copy()
    broken[0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        _ = Operators(broken, faces).laplacian


def test_only_positive_definite_matrices_have_factors() -> None:
    operators = Operators(*icosphere(1))
    with pytest.raises(InputError, match="cannot factorise"):
        Cholesky(-1 * operators.laplacian)
    with pytest.raises(InputError, match="not finite"):
        Cholesky(np.nan * operators.laplacian)
    with pytest.raises(ValueError, match="need 42 rows"):
        operators.heat.solve(np.ones(41))


def test_the_flat_torus_is_flat() -> None:
    operators = FlatTorus(6)
    assert operators.area == pytest.approx(1.0)
    assert operators.laplacian.diagonal() == pytest.approx(np.full(36, 4.0)), "the five-point stencil"
