"""Distances and eigenvalues from intrinsic lengths against libigl and potpourri3d on the same triangles."""

from __future__ import annotations

import igl
import numpy as np
import potpourri3d as pp3d
import pytest
from flat_surfaces import Mesh, pillow, rough_sphere
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.sparse.linalg import eigsh
from small_assets import icosphere, small_content, torus

from ndf_core.asset.asset import Asset
from ndf_core.kernels.delaunay import straight_lengths
from ndf_core.processing.exact_geodesics import exact_distances
from ndf_core.processing.heat_method import heat_distances
from ndf_core.processing.operators import Operators
from ndf_core.processing.spectrum import laplace_spectrum
from ndf_core.processing.surface_points import SurfacePoints


def extracted() -> Mesh:
    mesh = Asset(small_content(torus(), amplitude=0.05)).extract(0.25, measure_edges=False)
    return mesh.vertices, mesh.faces


def shaken_torus() -> Mesh:
    """Its squares have two Delaunay diagonals, each with its own mass, unless they are shaken."""
    vertices, faces = torus(40, 20)
    return vertices + np.random.default_rng(0).normal(scale=3e-3, size=vertices.shape), faces


MESHES = {
    "sphere": icosphere(3),
    "torus": shaken_torus(),
    "rough": rough_sphere(800),
    "needles": rough_sphere(400, seed=4, squeeze=0.1),
    "pillow": pillow(8),
    "extracted": extracted(),
}


@pytest.fixture(params=list(MESHES))
def operators(request: pytest.FixtureRequest) -> Operators:
    """Given the lengths of the edges, so that positions could only be used by mistake."""
    vertices, faces = MESHES[request.param]
    return Operators(vertices, faces, edge_lengths=straight_lengths(vertices, faces))


def from_vertices(operators: Operators, *sources: int) -> SurfacePoints:
    """By number: the pillow has two vertices at most places."""
    faces = np.array([np.flatnonzero((operators.faces == source).any(axis=1))[0] for source in sources])
    weights = (operators.faces[faces] == np.array(sources)[:, None]).astype(np.float64)
    return SurfacePoints(faces, weights, operators.vertices[list(sources)], np.zeros(len(sources)))


def distances(operators: Operators, source: int) -> Float[Array, " v"]:
    found, missed = exact_distances(operators, from_vertices(operators, source))
    assert missed == 0
    return found


def test_exact_distances_are_libigls(operators: Operators) -> None:
    """Both are MMP; libigl is given the positions."""
    sources, none = np.array([3, 100]), np.zeros(0, dtype=np.int64)
    everywhere = np.arange(len(operators.vertices))
    wide = operators.faces.astype(np.int64)
    theirs = igl.exact_geodesic(operators.vertices, wide, sources, none, everywhere, none)
    found, _ = exact_distances(operators, from_vertices(operators, *sources))
    np.testing.assert_allclose(found, theirs, rtol=1e-9, atol=1e-12)


def test_no_geodesic_of_edge_flips_is_shorter_and_most_are_as_long(operators: Operators) -> None:
    """Geometry-central shortens a path until it is straight, by code that has no windows: an upper bound."""
    flips = pp3d.EdgeFlipGeodesicSolver(operators.vertices, operators.faces)
    ends = np.random.default_rng(1).permutation(len(operators.vertices))[:40]
    found = distances(operators, 3)[ends]
    paths = [flips.find_geodesic_path(3, int(end)) for end in ends if end != 3]
    lengths = np.array([np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in paths])
    excess = lengths / found[ends != 3] - 1
    assert excess.min() > -1e-9
    assert (excess < 1e-6).mean() > 0.6


def test_heat_distances_are_potpourri3ds_up_to_a_constant(operators: Operators) -> None:
    """Theirs is shifted to zero at its least value, and solves with a slightly shifted Laplacian."""
    solver = pp3d.MeshHeatMethodDistanceSolver(operators.vertices, operators.faces, use_robust=True)
    theirs = solver.compute_distance(100)
    difference = heat_distances(operators, from_vertices(operators, 100)) - theirs
    assert np.ptp(difference) < 5e-5 * theirs.max()


def test_eigenvalues_are_those_of_libigls_matrices(operators: Operators) -> None:
    """Its own flips, its own Laplacian and mass of what they lead to, and a solver without our factor."""
    wide = operators.faces.astype(np.int64)
    given = igl.edge_lengths(operators.vertices, wide)
    lengths, flipped = igl.intrinsic_delaunay_triangulation(given, wide)[:2]
    laplacian = igl.cotmatrix_intrinsic(lengths, flipped)
    for kind, theirs in (("lumped", igl.MASSMATRIX_TYPE_BARYCENTRIC), ("galerkin", igl.MASSMATRIX_TYPE_FULL)):
        mass = igl.massmatrix_intrinsic(lengths, flipped, theirs)
        values = np.sort(eigsh(-laplacian, 12, mass.tocsc(), sigma=-1e-2, return_eigenvectors=False))
        ours = laplace_spectrum(operators, 12, kind).eigenvalues
        np.testing.assert_allclose(ours[1:], values[1:], rtol=1e-6)
