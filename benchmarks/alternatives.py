"""Computing on surfaces without a mesh of ours: point-cloud Laplacian, closest point method, and an asset.

    python benchmarks/alternatives.py [--case NAME ...]

Three shapes whose true surface is known: a thin shell (the ellipsoid of radii 1, 0.7 and 0.02); a raw cloud of
20,000 points of spot with noise of 0.2% of the longest side, without normals; and a real one, the 30,571 points of
the scanned bunny (o3d_bunnyData.pts). They lie within 1.3e-5 of the longest side of the mesh that Stanford made from
the scans (pmp_bunny.off), whose underside has holes that are filled in the mesh: ours opens them with `--open cap`.
Two tasks: ten eigenvalues of the Laplacian, and (1 - t Laplace) u = f with a smooth f of the position, whose u is
compared at 5,000 points of the true surface. The truth is a fine mesh of it, by libigl's cotangents.

`points` is robust_laplacian's Laplacian of the cloud (Sharp and Crane 2020); for the shell, of 20,000 exact points.
`grid` is the closest point method: cubic interpolation E, the 7-point Laplacian L, and the stabilised E L - g (1 - E)
(von Glehn, Maerz and Macdonald 2013) on a narrow band, with the closest point of the representation itself: the exact
surface of the shell, the nearest point of the cloud. `ours` is a mesh extracted from a fitted asset, whose fit is
counted apart: it happens once, on a server. Seconds are CPU seconds of one thread.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import igl
import numpy as np
import robust_laplacian
import scipy.sparse as sp
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.sparse.linalg import eigs, eigsh, splu
from scipy.spatial import KDTree

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals, interpolate
from ndf_core.processing.mesh_input import read_input
from ndf_core.processing.operators import Operators
from ndf_core.processing.spectrum import laplace_spectrum

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
RESULTS = Path(__file__).resolve().parent / "results" / "alternatives.json"
RADII = np.array([1.0, 0.7, 0.02])
POINTS, TESTED, EIGENVALUES = 20_000, 5_000, 10
NOISE = 2e-3
TIME = 0.01
"""Of the second task, in squares of the longest side."""
GRID = (30, 50)
"""Cells of the grid along the longest side."""
STEPS = 600
EDGES = (50, 100)
"""The longest side over our edge length."""

Answer = tuple[Array, Array, int]
"""Eigenvalues, u at the tested points, and the number of unknowns."""
ClosestPoint = Callable[[Float[Array, "n 3"]], Float[Array, "n 3"]]


@dataclass(frozen=True)
class Case:
    """A shape: its true surface, what the methods get of it, and what is asked."""

    name: str
    vertices: Float[Array, "v 3"]
    faces: Array
    cloud: Float[Array, "n 3"]
    closest: ClosestPoint
    tested: Float[Array, "m 3"]
    fit: Callable[[Path], Asset]

    @property
    def side(self) -> float:
        return float(np.ptp(self.vertices, axis=0).max())


def right_side(points: Float[Array, "n 3"], side: float) -> Float[Array, " n"]:
    return np.cos(4 * points[:, 0] / side) + np.sin(3 * points[:, 1] / side)


def symmetric(laplacian: Any, mass: Any, points: Array, case: Case) -> tuple[Array, Array]:
    """Both answers from a stiffness and a mass matrix."""
    scale = laplacian.diagonal().mean() / mass.diagonal().mean()
    found = eigsh(laplacian, EIGENVALUES + 1, mass, sigma=-1e-4 * scale, return_eigenvectors=False)
    system = sp.csc_matrix(mass + TIME * case.side**2 * laplacian)
    return np.sort(found)[1:], splu(system).solve(mass @ right_side(points, case.side))


def truth(case: Case) -> tuple[Array, Array]:
    laplacian = sp.csc_matrix(-igl.cotmatrix(case.vertices, case.faces))
    mass = sp.csc_matrix(igl.massmatrix(case.vertices, case.faces, igl.MASSMATRIX_TYPE_VORONOI))
    values, solution = symmetric(laplacian, mass, case.vertices, case)
    _, triangles, weights = TriangleBVH(case.vertices, case.faces).closest(case.tested)
    return values, interpolate(solution, case.faces[triangles], weights)


def by_points(case: Case) -> Answer:
    laplacian, mass = robust_laplacian.point_cloud_laplacian(case.cloud)
    values, solution = symmetric(sp.csc_matrix(laplacian), sp.csc_matrix(mass), case.cloud, case)
    return values, solution[KDTree(case.cloud).query(case.tested)[1]], len(case.cloud)


def by_grid(case: Case, cells: int) -> Answer:
    h = case.side / cells
    low = case.vertices.min(axis=0) - 6 * h
    shape = np.ceil((case.vertices.max(axis=0) + 6 * h - low) / h).astype(int) + 1
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    closest = case.closest(nodes * h + low)
    near = np.linalg.norm(nodes * h + low - closest, axis=1) < 4.2 * h  # sqrt(2 * 2^2 + 3^2), 3D and cubic
    nodes, closest = nodes[near], closest[near]
    index = np.full(shape, -1)
    index[tuple(nodes.T)] = np.arange(len(nodes))

    def spread(points: Array) -> sp.csr_array:
        """Cubic interpolation from the band."""
        first = np.floor((points - low) / h).astype(int) - 1
        x = (points - low) / h - first
        weights = [
            np.stack([np.prod([(x[:, a] - j) / (i - j) for j in range(4) if j != i], axis=0) for i in range(4)], 1)
            for a in range(3)
        ]
        offsets = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        columns = index[tuple((first[:, None] + offsets).reshape(-1, 3).T)].reshape(len(points), 64)
        entries = np.einsum("ni,nj,nk->nijk", *weights).reshape(len(points), 64)
        rows = np.repeat(np.arange(len(points)), 64)
        return sp.csr_array((entries.ravel(), (rows, columns.ravel())), shape=(len(points), len(nodes)))

    extension = spread(closest)
    inner = np.unique(extension.indices)  # where the Laplacian is asked for: all neighbours are in the band
    steps = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    neighbours = [index[tuple((nodes[inner] + step).T)] for step in steps]
    laplacian = sp.coo_array(
        (np.ones(6 * len(inner)), (np.tile(inner, 6), np.concatenate(neighbours))), shape=(len(nodes),) * 2
    ).tocsr()
    laplacian = (laplacian - sp.diags_array(laplacian.sum(axis=1))) / h**2
    identity = sp.eye_array(len(nodes))
    operator = sp.csc_matrix(extension @ laplacian - 6 / h**2 * (identity - extension))
    found = eigs(operator, EIGENVALUES + 1, sigma=1e-3 / case.side**2, return_eigenvectors=False)
    values = np.sort(-found.real)[1:]
    solution = splu(sp.csc_matrix(identity - TIME * case.side**2 * operator)).solve(right_side(closest, case.side))
    return values, spread(case.closest(case.tested)) @ solution, len(nodes)


def by_asset(case: Case, asset: Asset, parts: int) -> Answer:
    mesh = asset.extract(asset.longest_side / parts)
    operators = Operators.of(mesh)
    values = laplace_spectrum(operators, EIGENVALUES + 1).eigenvalues[1:]
    solver = operators.heat_step(TIME * case.side**2)
    solution = solver.solve(operators.mass("mean") @ right_side(mesh.vertices, case.side))
    return np.asarray(values), mesh.interpolate(solution, case.tested), len(mesh.vertices)


def shell() -> Case:
    vertices, faces = igl.upsample(*igl.icosahedron(), 6)
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True) * RADII
    tree = TriangleBVH(vertices, faces)
    points = _even(vertices, faces, POINTS + TESTED)

    def fit(folder: Path) -> Asset:
        file = folder / "shell.toml"
        file.write_text(f'type = "ellipsoid"\nradii = {RADII.tolist()}\n')
        return ndf_core.fit(ndf_core.open(file), faces=2000, steps=STEPS, threads=1)

    return Case("thin shell", vertices, faces, points[:POINTS], lambda q: tree.closest(q)[0], points[POINTS:], fit)


def cloud() -> Case:
    spot = read_input(DATA / "mesh" / "spot.obj")
    vertices, faces = igl.upsample(spot.vertices, spot.faces.astype(np.int64), 2)
    points = _even(vertices, faces, POINTS + TESTED)
    side = float(np.ptp(vertices, axis=0).max())
    noisy = points[:POINTS] + np.random.default_rng(1).normal(0, NOISE * side / 3**0.5, (POINTS, 3))
    tree = KDTree(noisy)

    def fit(folder: Path) -> Asset:
        file = folder / "cloud.xyz"
        np.savetxt(file, noisy)
        return ndf_core.fit(ndf_core.open(file, repr="points"), faces=2000, steps=STEPS, threads=1)

    return Case("raw cloud", vertices, faces, noisy, lambda q: noisy[tree.query(q)[1]], points[POINTS:], fit)


def scan() -> Case:
    bunny = read_input(DATA / "mesh" / "pmp_bunny.off")
    file = DATA / "pointcloud" / "o3d_bunnyData.pts"
    points = np.loadtxt(file, skiprows=1)
    tree = KDTree(points)

    def fit(folder: Path) -> Asset:
        return ndf_core.fit(ndf_core.open(file, repr="points", open="cap"), faces=2000, steps=STEPS, threads=1)

    tested = _even(bunny.vertices, bunny.faces, TESTED)
    faces = bunny.faces.astype(np.int64)
    return Case("scanned bunny", bunny.vertices, faces, points, lambda q: points[tree.query(q)[1]], tested, fit)


def _even(vertices: Float[Array, "v 3"], faces: Array, count: int) -> Float[Array, "n 3"]:
    rng = np.random.default_rng(0)
    areas = np.linalg.norm(face_normals(vertices, faces), axis=1)
    chosen = rng.choice(len(faces), count, p=areas / areas.sum())
    return np.einsum("nc,ncx->nx", rng.dirichlet((1.0, 1.0, 1.0), count), vertices[faces[chosen]])


def measured(case: Case) -> dict[str, Any]:
    """Errors and seconds of every method, against the truth."""
    true_values, true_solution = truth(case)
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        asset = case.fit(Path(folder))
    rows: dict[str, Any] = {"fit": {"seconds": time.process_time() - start, "bytes": asset.size}}
    methods: dict[str, Callable[[], Answer]] = {"points": lambda: by_points(case)}
    methods |= {f"ours 1/{parts}": partial(by_asset, case, asset, parts) for parts in EDGES}
    methods |= {f"grid 1/{cells}": partial(by_grid, case, cells) for cells in GRID}
    for name, method in methods.items():
        start = time.process_time()
        values, solution, unknowns = method()
        seconds = time.process_time() - start
        rows[name] = {
            "unknowns": unknowns,
            "eigenvalues": float(np.abs(values / true_values - 1).mean()),
            "heat": float(np.sqrt(((solution - true_solution) ** 2).mean() / true_solution.var())),
            "seconds": seconds,
        }
        print(case.name, name, json.dumps(rows[name]), file=sys.stderr, flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    results = json.loads(options.results.read_text()) if options.results.exists() else {}
    for name in options.case:
        results[name] = measured(CASES[name]())
        options.results.write_text(json.dumps(results, indent=1) + "\n")


CASES: dict[str, Callable[[], Case]] = {"shell": shell, "cloud": cloud, "scan": scan}

if __name__ == "__main__":
    main()
