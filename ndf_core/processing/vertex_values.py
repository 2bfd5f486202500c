"""Values on the vertices of a mesh as files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.files import atomic_write
from ndf_core.meshio import write_mesh
from ndf_core.processing.mesh_input import InputMesh

SUFFIXES = (".ply", ".npz")


def write_vertex_values(
    path: Path,
    mesh: InputMesh,
    values: Mapping[str, Float[Array, " v"]],
    colors: Float[Array, "v 3"],
    arrays: Mapping[str, Array],
) -> None:
    """Write a coloured .ply with one property for each of the values, or all arrays as .npz.

    Args:
        path: Its suffix decides.
        mesh: Written too; in an .npz of an asset's mesh with the base points of its vertices.
        values: By the name of the .ply's property.
        colors: sRGB in [0, 1].
        arrays: What an .npz holds instead of the two.

    Raises:
        OutputError: the file cannot be written.
    """
    if path.suffix.lower() == ".ply":
        write_mesh(path, mesh.vertices, mesh.faces, np.round(colors * 255).astype(np.uint8), values)
        return
    everything: dict[str, Any] = {"vertices": mesh.vertices, "faces": mesh.faces, **arrays}
    if mesh.extracted is not None:
        everything |= {"base_faces": mesh.extracted.base_faces, "base_barycentric": mesh.extracted.barycentric}
    with atomic_write(path) as file:
        np.savez(file, **everything)
