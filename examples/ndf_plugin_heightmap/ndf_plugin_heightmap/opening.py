"""From a file to a `Surface`. Imported when a run starts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from ndf_core.base_mesh.from_mesh import MeshExtractor
from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.mesh import face_normals
from ndf_core.surfaces.closest_point_projector import ClosestPointProjector
from ndf_core.surfaces.fingerprint import fingerprint
from numpy import ndarray as Array

from ndf_plugin_heightmap.heightmap import Config
from ndf_plugin_heightmap.terrain import read_terrain, solid

_DEPTH = 0.1


def open_heightmap(source: str | Path | object, config: Config) -> Surface:
    """Open an ESRI ASCII grid.

    Raises:
        InputError: it cannot be read; the message says which file and what is wrong with it.
    """
    if not isinstance(source, str | Path):
        raise InputError(f"heightmap: need a file, not {type(source).__name__}")
    terrain = read_terrain(Path(source))
    depth = config.depth or _DEPTH * terrain.spacing * max(terrain.heights.shape)
    vertices, faces = solid(terrain, depth)
    normals = face_normals(vertices, faces)
    areas = np.linalg.norm(normals, axis=1)

    def sample(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        chosen = rng.choice(len(faces), count, p=areas / areas.sum())
        weights = rng.dirichlet((1.0, 1.0, 1.0), count)
        points = np.einsum("nc,ncx->nx", weights, vertices[faces[chosen]])
        return points, normals[chosen] / areas[chosen, None]

    return Surface(
        representation="heightmap",
        base_mesh=MeshExtractor(vertices, faces),
        projector=ClosestPointProjector(vertices, faces.astype(np.int32)),
        fingerprint=fingerprint("heightmap", config, [terrain.heights, np.array([*terrain.corner, terrain.spacing])]),
        sample=sample,
        notes=(f"{terrain.heights.shape[0]} x {terrain.heights.shape[1]} heights over a base {depth:.4g} deep",),
    )
