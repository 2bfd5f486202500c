"""Samples of a surface as files, and as dots on the surface for a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_core.asset.asset import Asset
from ndf_core.files import atomic_write
from ndf_core.meshio import write_mesh
from ndf_core.processing.mesh_input import InputMesh
from ndf_core.processing.surface_sampling import SurfaceSamples

_DOT = 0.3
"""Radius of a dot, in typical distances of samples."""
_SURFACE, _INK = (0.82, 0.84, 0.88), (0.1, 0.15, 0.4)


def write_samples(path: Path, samples: SurfaceSamples) -> None:
    """Points with normals as .ply, or everything as .npz.

    Raises:
        OutputError: the file cannot be written.
    """
    if path.suffix.lower() == ".ply":
        normals = {f"n{axis}": samples.normals[:, i] for i, axis in enumerate("xyz")}
        write_mesh(path, samples.points, np.zeros((0, 3), np.int32), None, normals)
        return
    with atomic_write(path) as file:
        np.savez(
            file,
            points=samples.points,
            normals=samples.normals,
            base_faces=samples.base_faces,
            base_barycentric=samples.barycentric,
            radius=samples.radius,
        )


def dotted_surface(asset: Asset, samples: SurfaceSamples, threads: int = 1) -> tuple[InputMesh, Float[Array, "v 3"]]:
    """A mesh of the surface, and colours (sRGB) that show the samples as dots on it."""
    mesh = asset.extract(threads=threads)
    area = float(np.linalg.norm(_area_vectors(mesh.vertices, mesh.faces), axis=1).sum()) / 2
    dot = max(_DOT * np.sqrt(area / len(samples.points)), mesh.edge_length)
    distance = KDTree(samples.points).query(mesh.vertices)[0]
    colors = np.where((np.asarray(distance) < dot)[:, None], _INK, _SURFACE)
    return InputMesh(mesh.vertices, mesh.faces, extracted=mesh), colors


def _area_vectors(vertices: Float[Array, "v 3"], faces: Array) -> Float[Array, "f 3"]:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)
