"""The ways to a mesh that `extraction.py` compares. Each yields meshes with the CPU seconds that they took."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from extraction_shapes import Mesh, Shape
from extraction_tasks import largest_component, timed

from ndf_core.asset.asset import Asset
from ndf_core.base_mesh.marching_cubes import marching_cubes
from ndf_core.base_mesh.narrow_band import sample_near_level_set

OUR_LENGTHS = (0.2, 0.1, 0.07, 0.05, 0.035, 0.025)
GRID_SIZES = (0.1, 0.06, 0.04, 0.03, 0.02, 0.015)
REMESHED = ((0.1, 2), (0.07, 2), (0.05, 2), (0.14, 4), (0.1, 4))
"""Edge lengths asked of the remeshers, and cells of marching cubes to each edge. One cell to an edge is worse than no
remeshing at all: the vertices slide on a surface that is as coarse as they are."""
ITERATIONS = 5


@dataclass(frozen=True)
class Meshed:
    method: str
    size: float
    """Edge length or grid size, in the box of 3."""
    vertices: np.ndarray
    faces: np.ndarray
    seconds: float
    edge_lengths: np.ndarray | None = None
    """Along the surface, where they are known."""


def ours(shape: Shape) -> Iterator[Meshed]:
    scale = Asset.load(shape.asset).content.scale

    def extract(length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        asset = Asset.load(shape.asset)
        mesh = asset.extract(length * scale)
        return (mesh.vertices - asset.content.center) / scale, mesh.faces, mesh.edge_lengths / scale

    extract(0.5)
    for length in OUR_LENGTHS:
        (vertices, faces, lengths), seconds = timed(lambda length=length: extract(length))
        yield Meshed("ours", length, vertices, faces, seconds, lengths)


def marching(shape: Shape, cell: float) -> tuple[Mesh, float]:
    """Narrow band and marching cubes; the band found by distances or by signs, whichever is faster."""
    cells = max(8, round(float(np.ptp(shape.bounds, axis=0).max()) / cell))

    def extract(lipschitz: float | None) -> Mesh:
        distance = shape.distance if lipschitz is not None else None
        return largest_component(
            *marching_cubes(sample_near_level_set(shape.field, shape.bounds, cells, lipschitz, distance))
        )

    ways = [shape.lipschitz] if shape.mesh else [shape.lipschitz, None]
    return min((timed(lambda way=way: extract(way)) for way in ways), key=lambda found: found[1])


def plain(shape: Shape) -> Iterator[Meshed]:
    for cell in GRID_SIZES:
        (vertices, faces), seconds = marching(shape, cell)
        yield Meshed("marching cubes", cell, vertices, faces, seconds)


def remeshed(shape: Shape, name: str) -> Iterator[Meshed]:
    """Marching cubes, then isotropic remeshing by gpytoolbox or PyMeshLab."""
    remesh = {"Botsch-Kobbelt": _botsch, "PyMeshLab": _pymeshlab}[name]
    for length, finer in REMESHED:
        (vertices, faces), first = marching(shape, length / finer)
        (points, corners), second = timed(lambda v=vertices, f=faces, length=length: remesh(v, f, length))
        yield Meshed(
            f"marching cubes 1/{finer} + {name}", length, *largest_component(points, corners), first + second
        )


def _botsch(vertices: np.ndarray, faces: np.ndarray, length: float) -> Mesh:
    from gpytoolbox import remesh_botsch

    points, corners = remesh_botsch(vertices, faces.astype(np.int32), ITERATIONS, length, True)
    return points, np.ascontiguousarray(corners, dtype=np.int32)


def _pymeshlab(vertices: np.ndarray, faces: np.ndarray, length: float) -> Mesh:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshes.meshing_isotropic_explicit_remeshing(iterations=ITERATIONS, targetlen=pymeshlab.PureValue(length))
    found = meshes.current_mesh()
    return np.array(found.vertex_matrix()), np.ascontiguousarray(found.face_matrix(), dtype=np.int32)
