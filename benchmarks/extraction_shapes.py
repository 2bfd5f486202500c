"""A shape of `extraction.py`: its field, its asset, and its reference solutions. All in the asset's box of side 3."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from extraction_tasks import EIGENVALUES, SOURCES, exact_geodesics, largest_component, spectrum_error
from jaxtyping import Float, Int
from numpy import ndarray as Array

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.base_mesh.marching_cubes import marching_cubes
from ndf_core.base_mesh.mesh_distance import MeshDistance
from ndf_core.base_mesh.narrow_band import sample_near_level_set
from ndf_core.processing.operators import Operators
from ndf_core.processing.spectrum import laplace_spectrum
from ndf_core.readers.mesh_file import read_mesh_file
from ndf_core.surfaces.closed_mesh import closed_mesh

CACHE = Path(__file__).parent / ".cache"
MOST_FACES_GEODESICS, MOST_FACES_SPECTRUM = 100_000, 250_000
REFERENCE_CELLS = 200
_MARGIN = 0.01
Field = Callable[[Float[Array, "n 3"]], Float[Array, " n"]]
Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]


@dataclass(frozen=True)
class Shape:
    """What a client could query (the field), and what it was sent (the asset)."""

    name: str
    neural: bool
    asset: Path
    field: Field
    """Negative inside."""
    distance: Field | None
    """Its absolute value, where that is cheaper."""
    bounds: Float[Array, "2 3"]
    lipschitz: float
    project: Callable[[Float[Array, "n 3"]], Float[Array, "n 3"]]
    """Onto the true surface."""
    mesh: Mesh | None
    """The surface itself, where it is a mesh."""


@dataclass(frozen=True)
class Reference:
    """Solutions on the true surface."""

    vertices: Float[Array, "v 3"]
    weights: Float[Array, " v"]
    """Area around each vertex."""
    sources: Float[Array, "2 3"]
    distances: Float[Array, " v"]
    eigenvalues: Float[Array, " k"]
    area: float
    facts: dict[str, Any]


def open_shape(source: Path, asset: Path) -> Shape:
    content = Asset.load(asset).content
    center, scale = content.center, content.scale
    surface = ndf_core.open(source)

    def to_box(points: Array) -> Array:
        return (points - center) / scale

    def project(points: Array) -> Array:
        found = surface.projector.project(torch.from_numpy(points * scale + center))
        return np.where(found.converged.numpy()[:, None], to_box(found.points.numpy()), points)

    if surface.representation == "mesh":
        mesh = closed_mesh(read_mesh_file(source), None, source.name)
        vertices = to_box(mesh.vertices)
        signed = MeshDistance(vertices, mesh.faces)
        bounds = np.stack([vertices.min(axis=0) - _MARGIN, vertices.max(axis=0) + _MARGIN])
        return Shape(
            source.stem, False, asset, signed.signed, signed.unsigned, bounds, 1.0, project, (vertices, mesh.faces)
        )
    field = surface.projector._field  # the ImplicitField, which a `Surface` does not show
    evaluate = field.on_arrays()
    bounds = to_box(np.stack([field.bounds.lower, field.bounds.upper]))
    return Shape(
        source.stem,
        True,
        asset,
        lambda points: evaluate(points * scale + center),
        None,
        bounds,
        field.lipschitz * scale,
        project,
        None,
    )


def reference_of(shape: Shape) -> Reference:
    """From the cache, or computed: exact geodesics on at most 100,000 faces, eigenvalues on at most 250,000."""
    code = "".join(
        Path(__file__).with_name(name).read_text() for name in ("extraction_shapes.py", "extraction_tasks.py")
    )
    key = hashlib.sha256(shape.asset.read_bytes() + code.encode()).hexdigest()[:16]
    path = CACHE / f"{shape.name}_{key}.npz"
    if not path.exists():
        CACHE.mkdir(exist_ok=True)
        found = _from_mesh(*shape.mesh) if shape.mesh else _from_field(shape)
        np.savez(path, **found)
    with np.load(path) as stored:
        arrays = dict(stored)
    facts = {key: arrays.pop(key).item() for key in list(arrays) if key.startswith("fact_")}
    return Reference(**arrays, facts={key.removeprefix("fact_"): value for key, value in facts.items()})


def _from_mesh(vertices: Array, faces: Array) -> dict[str, Any]:
    """The mesh is the surface: its own distances are exact, and finer triangles on it show the eigenvalues' limit."""
    if len(faces) > MOST_FACES_GEODESICS:
        raise SystemExit(f"a mesh of {len(faces):,} faces is too large to be its own reference")
    levels = [(vertices, faces)]
    while 4 * len(levels[-1][1]) <= MOST_FACES_SPECTRUM:
        levels.append(halved(*levels[-1]))
    solved = [Operators(*level) for level in levels]
    values = [laplace_spectrum(operators, EIGENVALUES).eigenvalues for operators in solved]
    limit = values[0] if len(values) == 1 else _extrapolated(*values[-2:], *solved[-2:])
    sources = solved[0].closest(SOURCES).positions
    return {
        **_solved(solved[0], sources, exact_geodesics(solved[0], sources).distances, limit, solved[0].area),
        "fact_faces_geodesics": len(faces),
        "fact_faces_spectrum": len(solved[-1].faces),
        "fact_extrapolation_of_eigenvalues": spectrum_error(values[-1], limit),
        "fact_masses_apart": _masses_apart(solved[-1]),
    }


def _from_field(shape: Shape) -> dict[str, Any]:
    """App. B.2: marching cubes, isotropic remeshing; then the vertices are put onto the level set.

    Triangles cut the corners of a curved surface by a share that goes with one over their number. Meshes of the sizes
    allowed still show that, so eigenvalues and distances are extrapolated from two of them.
    """
    band = sample_near_level_set(shape.field, shape.bounds, REFERENCE_CELLS, shape.lipschitz)
    dense = largest_component(*marching_cubes(band))
    coarse, middle, fine = (
        Operators(*_remeshed(shape, dense, most))
        for most in (MOST_FACES_GEODESICS // 3, MOST_FACES_GEODESICS, MOST_FACES_SPECTRUM)
    )
    values = [laplace_spectrum(operators, EIGENVALUES).eigenvalues for operators in (middle, fine)]
    limit = _extrapolated(*values, middle, fine)
    sources = middle.closest(SOURCES).positions
    finer = exact_geodesics(middle, sources).at(middle.closest(coarse.vertices))
    distances = _extrapolated(exact_geodesics(coarse, sources).distances, finer, coarse, middle)
    area = float(_extrapolated(np.array(middle.area), np.array(fine.area), middle, fine))
    return {
        **_solved(coarse, sources, distances, limit, area),
        "fact_faces_geodesics": len(middle.faces),
        "fact_faces_spectrum": len(fine.faces),
        "fact_extrapolation_of_eigenvalues": spectrum_error(values[1], limit),
        "fact_extrapolation_of_geodesics": float(np.abs(finer - distances).sum() / distances.sum()),
    }


def _remeshed(shape: Shape, dense: Mesh, most: int) -> Mesh:
    from gpytoolbox import remesh_botsch

    length = np.sqrt(Operators(*dense).area / (0.9 * most) * 4 / np.sqrt(3))
    vertices, faces = remesh_botsch(dense[0], dense[1].astype(np.int32), 10, float(length), True)
    if len(faces) > most:
        raise SystemExit(f"{shape.name}: the reference has {len(faces):,} faces, more than {most:,}")
    return shape.project(vertices), np.ascontiguousarray(faces, dtype=np.int32)


def _extrapolated(rough: Array, better: Array, one: Operators, two: Operators) -> Array:
    return better + (better - rough) / (len(two.faces) / len(one.faces) - 1)


def _solved(
    operators: Operators, sources: Array, distances: Array, eigenvalues: Array, area: float
) -> dict[str, Any]:
    return {
        "vertices": operators.vertices,
        "weights": operators.lumped_mass,
        "sources": sources,
        "distances": distances,
        "eigenvalues": eigenvalues,
        "area": area,
    }


def _masses_apart(operators: Operators) -> float:
    """Half of what the other two masses' eigenvalues differ by: a bound for what the mean mass's may be off."""
    lumped, galerkin = (laplace_spectrum(operators, EIGENVALUES, kind).eigenvalues for kind in ("lumped", "galerkin"))
    return 0.5 * spectrum_error(lumped, galerkin)


def halved(vertices: Array, faces: Array) -> Mesh:
    """Every triangle in four, on the same surface."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end).astype(np.int64) * len(vertices) + np.maximum(start, end)
    keys, middle = np.unique(key, return_inverse=True)
    middles = 0.5 * (vertices[keys // len(vertices)] + vertices[keys % len(vertices)])
    ab, bc, ca = (len(vertices) + middle.reshape(-1, 3)).T
    a, b, c = faces.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([vertices, middles]), np.concatenate([np.stack(part, axis=1) for part in parts]).astype(
        np.int32
    )
