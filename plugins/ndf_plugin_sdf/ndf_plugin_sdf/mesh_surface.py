"""Opening `mesh`: a file becomes a closed mesh, and the mesh a surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.base_mesh.from_mesh import MeshExtractor
from ndf_core.base_mesh.level_set import LevelSetPolicy
from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.mesh import face_normals
from ndf_core.readers.mesh_file import read_mesh_file
from ndf_core.readers.polygons import RawMesh
from ndf_core.surfaces.closed_mesh import ClosedMesh, closed_mesh
from ndf_core.surfaces.closest_point_projector import ClosestPointProjector
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_plugin_sdf.defaults import TRAINING_DEFAULTS
from ndf_plugin_sdf.mesh import MeshConfig


def open_mesh(source: str | Path | object, config: MeshConfig) -> Surface:
    """Open a mesh file, or a pair of arrays (vertices (v, 3), faces (f, 3)).

    Raises:
        InputError: it cannot be read, or is not a closed surface.
    """
    if isinstance(source, str | Path):
        raw, origin = read_mesh_file(Path(source)), str(source)
    else:
        raw, origin = _from_arrays(source), "the arrays"
    mesh = closed_mesh(raw, config.merge_tolerance, origin)
    policy = LevelSetPolicy(resolution=config.resolution, max_resolution=2 * config.resolution)
    return Surface(
        representation="mesh",
        base_mesh=MeshExtractor(mesh.vertices, mesh.faces, method=config.base_mesh, policy=policy),
        projector=ClosestPointProjector(mesh.vertices, mesh.faces),
        fingerprint=fingerprint("mesh", config, [mesh.vertices, mesh.faces]),
        training_defaults=TRAINING_DEFAULTS,
        sample=lambda count, rng: sample_triangles(mesh, count, rng),
        notes=mesh.notes,
    )


def sample_triangles(
    mesh: ClosedMesh, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """`count` points even by area, and the normals of their faces; input units."""
    area_vectors = face_normals(mesh.vertices, mesh.faces)
    area = np.linalg.norm(area_vectors, axis=1)
    face = rng.choice(len(area), size=count, p=area / area.sum())
    # Uniform in a triangle: the parallelogram's coordinates, folded over its diagonal.
    u, v = rng.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    a, b, c = (mesh.vertices[mesh.faces[face, i]] for i in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), area_vectors[face] / area[face, None]


def _from_arrays(source: Any) -> RawMesh:
    try:
        vertices, faces = source
        vertices, faces = np.array(vertices, dtype=np.float64), np.array(faces)
    except (TypeError, ValueError) as error:
        raise InputError("mesh: need a file, or a pair of arrays (vertices, faces)") from error
    if (
        vertices.ndim != 2
        or vertices.shape[1] != 3
        or faces.ndim != 2
        or faces.shape[1] != 3
        or faces.dtype.kind not in "iu"
    ):
        raise InputError("mesh: need vertices (v, 3) of numbers and faces (f, 3) of integers")
    if not len(faces):
        raise InputError("mesh: there are no triangles")
    return RawMesh(vertices, faces.astype(np.int64))
