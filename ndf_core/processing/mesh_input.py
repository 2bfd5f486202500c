"""What the processing commands compute on: the mesh of a file, or one extracted from an asset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.asset.asset import Asset
from ndf_core.asset.file import MAGIC
from ndf_core.errors import ConfigError, InputError
from ndf_core.extract.extracted import ExtractedMesh
from ndf_core.mesh import signed_volume
from ndf_core.readers.mesh_file import read_mesh_file
from ndf_core.surfaces.edges import Edges, orient
from ndf_core.surfaces.welding import weld

_ROUNDING = 1e-6
"""Of coordinates in single precision, as a share of the longest side."""


@dataclass(frozen=True)
class InputMesh:
    """An oriented triangle mesh, manifold along its edges, every vertex used."""

    vertices: Float[Array, "v 3"]
    """float64, in the coordinates of the file, or of the input that the asset was fitted to."""
    faces: Int[Array, "f 3"]
    """int32."""
    notes: tuple[str, ...] = ()
    """What was changed, for the user."""
    extracted: ExtractedMesh | None = None
    """Where the input is an asset."""


def read_input(path: Path, edge_length: float | None = None, threads: int = 1) -> InputMesh:
    """Read a mesh file, or extract a mesh from an asset.

    Args:
        path: Told apart by content.
        edge_length: As in `Asset.extract`; for assets alone.
        threads: For extraction.

    Raises:
        InputError: the file cannot be read, or its mesh is no oriented manifold along its edges.
        AssetError: the asset is damaged.
        ConfigError: an edge length was given with a mesh file.
        ExtractionError: as `Asset.extract`.
    """
    if _is_asset(path):
        mesh = Asset.load(path).extract(edge_length, threads)
        return InputMesh(mesh.vertices, mesh.faces, extracted=mesh)
    raw = read_mesh_file(path)
    if edge_length is not None:
        raise ConfigError(f"--edge-length is for assets: {path} is a mesh and is computed on as it is")
    found = manifold_mesh(raw.vertices, raw.faces, str(path))
    return replace(found, notes=(*raw.notes, *found.notes))


def manifold_mesh(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], origin: str) -> InputMesh:
    """Drop unused vertices, merge equal ones where the mesh has a border otherwise, turn faces to agree.

    A mesh that is closed as its indices say keeps vertices that coincide, and so does one that merging would make
    non-manifold.

    Raises:
        InputError: indices out of range, coordinates that are not finite, edges with more than two triangles, or a
            one-sided surface.
    """
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise InputError(f"{origin}: a triangle names a vertex that does not exist, of {len(vertices):,}")
    proper = (faces != faces[:, [1, 2, 0]]).all(axis=1)
    vertices, faces = _used(vertices, faces[proper])
    if not np.isfinite(vertices).all():
        raise InputError(f"{origin}: {int((~np.isfinite(vertices).all(axis=1)).sum()):,} vertices are not finite")
    notes = () if proper.all() else (f"{int((~proper).sum()):,} degenerate triangles dropped",)
    if not len(faces):
        raise InputError(f"{origin}: all its triangles are degenerate: no three different corners")
    vertices, faces, merged = _joined(vertices, faces)
    notes = (*notes, *merged)
    edges = Edges.of(faces, len(vertices))
    crowded = edges.uses > 2
    if crowded.any():
        place = ", ".join(f"{x:.6g}" for x in vertices[edges.ends[crowded.argmax()]].mean(axis=0))
        raise InputError(
            f"{origin}: the mesh is not a manifold: {int(crowded.sum()):,} edges with more than two triangles, one "
            f"near ({place}). Fit it as a soup first (ndf fit --repr soup) and use the asset"
        )
    inner = edges.uses == 2
    pairs = Edges(edges.ends[inner], edges.uses[inner], edges.first[inner], edges.order)
    faces, turned = orient(faces, pairs, origin)
    if turned:
        notes = (*notes, f"{turned:,} triangles turned over to face the same way as their neighbours")
    if inner.all() and signed_volume(vertices, faces) < 0:
        faces, notes = faces[:, ::-1], (*notes, "the mesh was inside out; all triangles turned over")
    return InputMesh(*_used(vertices, faces), notes=notes)


def _joined(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], list[str]]:
    """Merge equal vertices, and those within the rounding of single precision where that closes the mesh."""
    best = vertices, faces, list[str]()
    uses = Edges.of(faces, len(vertices)).uses
    if (uses == 2).all():
        return best
    size = float(np.ptp(vertices, axis=0).max())
    for tolerance in (0.0, _ROUNDING * size):
        merged = weld(vertices, faces, tolerance)
        after = Edges.of(merged[1], len(merged[0])).uses
        if (after == 2).all():
            return merged
        if tolerance == 0 and ((after <= 2).all() or (uses > 2).any()):
            best = merged
    return best


def _used(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> tuple[Float[Array, "w 3"], Int[Array, "f 3"]]:
    """Only the vertices that faces name; merging may drop a vertex's last face."""
    used, inverse = np.unique(faces, return_inverse=True)
    return vertices[used].astype(np.float64), inverse.reshape(-1, 3).astype(np.int32)


def _is_asset(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC or path.suffix.lower() == ".ndf"
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
