"""From the triangles of a file to a closed, consistently oriented surface, or to the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import inside_out_components
from ndf_core.errors import InputError
from ndf_core.mesh import face_components, signed_volume
from ndf_core.readers.polygons import RawMesh
from ndf_core.surfaces.edges import Edges, orient, split_vertices
from ndf_core.surfaces.welding import weld

_SMALLEST, _LARGEST = 1e-60, 1e60
"""Sizes whose squares and cubes are far from the ends of float64."""
_ROUNDING = 1e-6
"""Of coordinates in single precision, as a share of the longest side: a few units in the last place."""
_FLAT = 1e-13
"""Volumes below this share of the longest side cubed are none."""


@dataclass(frozen=True)
class ClosedMesh:
    """A closed surface: every edge has two triangles that run through it in opposite directions, normals outwards."""

    vertices: Float[Array, "v 3"]
    """float64, in the file's coordinates."""
    faces: Int[Array, "f 3"]
    """int32."""
    notes: tuple[str, ...]
    """What was changed, for the user."""


def closed_mesh(raw: RawMesh, merge_tolerance: float | None, origin: str) -> ClosedMesh:
    """Check, merge, orient.

    A mesh that is closed as its indices say is left as it is, even where vertices coincide. Otherwise vertices at
    the same place become one (STL has no indices; textures and normals split vertices in other formats), and where
    that is not enough, those that differ by the rounding of single precision.

    Args:
        raw: the triangles.
        merge_tolerance: vertices at most this far apart become one, as a share of the longest side; 0 merges only
            equal ones; None decides as said above.
        origin: the file's name, for messages.

    Raises:
        InputError: indices out of range, coordinates that are not finite, a surface that is open, not manifold, not
            orientable, or without volume.
    """
    vertices, faces = _used(raw.vertices, raw.faces, origin)
    size = float((vertices.max(axis=0) - vertices.min(axis=0)).max())
    if not (_SMALLEST < size < _LARGEST and np.abs(vertices).max() < _LARGEST):
        raise InputError(f"{origin}: its longest side is {size:g}; it must be between {_SMALLEST:g} and {_LARGEST:g}")
    notes = list(raw.notes)
    if merge_tolerance or not _proper(faces, len(vertices)):
        vertices, faces, merged = _merged(vertices, faces, size, merge_tolerance)
        notes += merged
    if not len(faces):
        raise InputError(f"{origin}: all its triangles are degenerate: no three different corners")
    edges = Edges.of(faces, len(vertices))
    _require_closed(edges, vertices, origin)
    faces, turned = orient(faces, edges, origin)
    if turned:
        notes.append(f"{turned:,} triangles turned over to face the same way as their neighbours")
    vertices, faces, split = split_vertices(vertices, faces)
    if split:
        notes.append(f"{split:,} vertices split where parts of the surface touch in a point")
    faces, outward = _outwards(vertices, faces, size, origin)
    return ClosedMesh(vertices, np.ascontiguousarray(faces, dtype=np.int32), (*notes, *outward))


def _used(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], origin: str
) -> tuple[Float[Array, "w 3"], Int[Array, "f 3"]]:
    """Only the vertices that faces name, after checking that these exist and are finite."""
    wrong = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
    if wrong.any():
        row = int(wrong.argmax())
        raise InputError(
            f"{origin}: {int(wrong.sum()):,} of {len(faces):,} triangles name vertices that do not exist, first "
            f"triangle {row} (counted from 0), {faces[row].tolist()}, of {len(vertices):,} vertices"
        )
    used, faces = np.unique(faces, return_inverse=True)
    vertices = np.ascontiguousarray(vertices[used], dtype=np.float64)
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        row = int(used[bad.argmax()])
        raise InputError(f"{origin}: {int(bad.sum()):,} vertices are not finite numbers, first vertex {row} (from 0)")
    return vertices, faces.reshape(-1, 3)


def _merged(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], size: float, tolerance: float | None
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], list[str]]:
    exact = weld(vertices, faces, (tolerance or 0.0) * size)
    if tolerance is None and not _proper(exact[1], len(exact[0])):
        nearly = weld(vertices, faces, _ROUNDING * size)
        if _proper(nearly[1], len(nearly[0])):
            return nearly
    return exact


def _proper(faces: Int[Array, "f 3"], count: int) -> bool:
    """Whether the indices make a closed, edge-manifold surface without degenerate faces."""
    distinct = (faces != faces[:, [1, 2, 0]]).all()
    return len(faces) > 0 and bool(distinct) and bool((Edges.of(faces, count).uses == 2).all())


def _require_closed(edges: Edges, vertices: Float[Array, "v 3"], origin: str) -> None:
    boundary, crowded = edges.uses == 1, edges.uses > 2
    faults: list[str] = []
    for wrong, words in ((boundary, "boundary edges"), (crowded, "edges with more than two triangles")):
        if wrong.any():
            place = ", ".join(f"{x:.6g}" for x in vertices[edges.ends[wrong.argmax()]].mean(axis=0))
            faults.append(f"{int(wrong.sum()):,} {words}, one near ({place})")
    if faults:
        what = "not closed" if boundary.any() else "not a manifold"
        raise InputError(
            f"{origin}: the mesh is {what}: it has {' and '.join(faults)}. Read it as a soup with --repr soup, or "
            "raise --merge-tolerance if vertices that belong together lie a little apart"
        )


def _outwards(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], size: float, origin: str
) -> tuple[Int[Array, "f 3"], list[str]]:
    """Turn the whole mesh over if its volume is negative, then components that are neither outwards nor cavities."""
    notes: list[str] = []
    volume = signed_volume(vertices, faces)
    if abs(volume) < _FLAT * size**3:
        raise InputError(f"{origin}: the mesh encloses no volume: it is flat, or its parts cancel")
    if volume < 0:
        faces = faces[:, ::-1]
        notes.append("the mesh was inside out; all triangles turned over")
    wrong = inside_out_components(vertices, faces)
    if len(wrong):
        turn = np.isin(face_components(faces, len(vertices)), wrong)
        faces = np.where(turn[:, None], faces[:, ::-1], faces)
        notes.append(f"{len(wrong):,} components were inside out and have been turned over")
    return faces, notes
