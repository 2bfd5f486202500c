"""Eigenvalues and eigenfunctions: closed forms, laws, an independent assembly."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from flat_surfaces import FlatTorus, pillow, pillow_eigenvalues, rough_sphere
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.sparse import diags_array
from scipy.sparse.linalg import eigsh
from scipy.spatial.transform import Rotation
from small_assets import icosphere, torus

from ndf_core.errors import InputError
from ndf_core.processing import spectrum
from ndf_core.processing.operators import Operators
from ndf_core.processing.spectrum import laplace_spectrum


def sphere_eigenvalues(count: int) -> Float[Array, " k"]:
    return np.concatenate([np.full(2 * degree + 1, degree * (degree + 1.0)) for degree in range(count)])[:count]


def mean_error(found: Float[Array, " k"], true: Float[Array, " k"]) -> float:
    return float(np.abs(found[1:] / true[1:] - 1).mean())


@pytest.mark.parametrize("mass", ["mean", "lumped", "galerkin"])
def test_sphere_converges_with_the_square_of_the_edge_length(mass) -> None:
    errors = [
        mean_error(laplace_spectrum(Operators(*icosphere(level)), 25, mass).eigenvalues, sphere_eigenvalues(25))
        for level in (3, 4)
    ]
    assert errors[1] < 7e-3
    assert errors[0] / errors[1] > 3.5


def test_multiplicities_on_the_sphere() -> None:
    values = laplace_spectrum(Operators(*icosphere(4)), 16).eigenvalues
    groups = np.split(values, [1, 4, 9])
    assert [group.mean() for group in groups] == pytest.approx([0, 2, 6, 12], rel=3e-3)
    assert max(np.ptp(group) for group in groups) < 0.02


def test_the_mean_mass_is_the_most_accurate_on_good_meshes() -> None:
    operators, true = Operators(*icosphere(3)), sphere_eigenvalues(20)
    errors = {kind: mean_error(laplace_spectrum(operators, 20, kind).eigenvalues, true) for kind in
              ("mean", "lumped", "galerkin")}  # fmt: skip
    assert errors["mean"] < min(errors["lumped"], errors["galerkin"]) / 3


@pytest.mark.parametrize("side", [12, 40])
def test_flat_torus_has_its_closed_form(side: int) -> None:
    values = laplace_spectrum(FlatTorus(side), 13).eigenvalues
    assert mean_error(values, FlatTorus.eigenvalues(13)) < 6.0 / side**2


def test_pillow_has_its_closed_form() -> None:
    """Flat with four cone points, its triangles right-angled: even and odd functions of a square."""
    errors = [
        mean_error(laplace_spectrum(Operators(*pillow(n)), 15).eigenvalues, pillow_eigenvalues(15)) for n in (12, 24)
    ]
    assert errors[1] < 0.01
    assert errors[1] < errors[0] / 3


@pytest.mark.parametrize("mass", ["mean", "lumped", "galerkin"])
def test_eigenfunctions_are_orthonormal_and_solve_the_problem(mass) -> None:
    for mesh in (icosphere(2), icosphere(3), rough_sphere(squeeze=0.1)):
        operators = Operators(*mesh)
        found = laplace_spectrum(operators, 10, mass)
        functions, weights = found.eigenfunctions, operators.mass(mass)
        np.testing.assert_allclose(functions.T @ (weights @ functions), np.eye(10), atol=1e-9)
        residual = operators.laplacian @ functions - weights @ functions * found.eigenvalues
        assert np.abs(residual).max() < 1e-8 * found.eigenvalues[-1]
        assert (np.diff(found.eigenvalues) >= 0).all()
        assert 0 <= found.eigenvalues[0] < 1e-9
        assert (functions.max(axis=0) == np.abs(functions).max(axis=0)).all(), "the sign"


def test_one_zero_for_each_component() -> None:
    vertices, faces = icosphere(3)
    operators = Operators(np.concatenate([vertices, vertices + 3]), np.concatenate([faces, faces + len(vertices)]))
    values = laplace_spectrum(operators, 4).eigenvalues
    assert values[1] < 1e-9 < 1 < values[2]


def test_dense_and_sparse_solvers_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    operators = Operators(*rough_sphere(350))
    dense = laplace_spectrum(operators, 12)
    monkeypatch.setattr(spectrum, "_DENSE", 10)
    sparse = laplace_spectrum(operators, 12)
    np.testing.assert_allclose(dense.eigenvalues, sparse.eigenvalues, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(dense.eigenfunctions[:, 1:], sparse.eigenfunctions[:, 1:], atol=1e-6)


def test_equals_libigl() -> None:
    """An independent intrinsic Delaunay Laplacian of a mesh that is not Delaunay, by a solver without our factor."""
    vertices, faces = rough_sphere(800, seed=4, squeeze=0.3)
    operators = Operators(vertices, faces)
    laplacian, *_ = igl.intrinsic_delaunay_cotmatrix(vertices, faces.astype(np.int64))
    mass = diags_array(operators.lumped_mass).tocsc()  # igl's is that of the triangulation before the flips
    theirs = np.sort(eigsh(-laplacian, 10, mass, sigma=-1e-2, return_eigenvectors=False))
    ours = laplace_spectrum(operators, 10, "lumped").eigenvalues
    np.testing.assert_allclose(ours[1:], theirs[1:], rtol=1e-9)


def test_motion_and_scale() -> None:
    vertices, faces = torus(40, 20)
    turn = Rotation.from_euler("xyz", [1.0, 2.0, 3.0]).as_matrix()
    one = laplace_spectrum(Operators(vertices, faces), 8).eigenvalues
    two = laplace_spectrum(Operators(1e3 * vertices @ turn.T + [100.0, 0.0, 0.0], faces), 8).eigenvalues
    np.testing.assert_allclose(1e6 * two, one, rtol=1e-8, atol=1e-9)


def test_the_same_on_every_run() -> None:
    one, two = (laplace_spectrum(Operators(*icosphere(3)), 9) for _ in range(2))
    np.testing.assert_array_equal(one.eigenfunctions, two.eigenfunctions)


def test_all_of_a_small_mesh() -> None:
    operators = Operators(*icosphere(0))
    assert len(laplace_spectrum(operators, 12).eigenvalues) == 12


@pytest.mark.parametrize("count", [0, -3, 13])
def test_more_than_there_are_is_an_error(count: int) -> None:
    with pytest.raises(InputError, match=f"{count} eigenvalues of a mesh with 12 vertices: ask for 1 to 12"):
        laplace_spectrum(Operators(*icosphere(0)), count)


def test_more_than_fits_in_memory_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spectrum, "_MOST_NUMBERS", 50_000)
    operators = Operators(*icosphere(3))
    with pytest.raises(InputError, match="do not fit in memory: ask for 38 at most"):
        laplace_spectrum(operators, 39)
    assert len(laplace_spectrum(operators, 38).eigenvalues) == 38
