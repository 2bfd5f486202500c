"""The base mesh as it is stored: on an integer grid, in Draco's order, checked again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.asset.base_mesh_codec import BOX_SIDE, MAX_BITS, decode_base_mesh, encode_integer_mesh
from ndf_core.asset.placement import Placement
from ndf_core.base_mesh.checks import check_base_mesh, longest_side
from ndf_core.base_mesh.intersections import self_intersections
from ndf_core.errors import AssetError, BaseMeshError
from ndf_core.interfaces import BaseMesh
from ndf_core.mesh import Topology, face_normals, topology

MIN_COSINE = 0.5
"""Rounding may turn no triangle by more than 60 degrees."""
TOLERATED_CROSSINGS = 0.05
"""Where parts run through each other already, rounding may add this share of pairs along their lines."""


@dataclass(frozen=True)
class EncodedBaseMesh:
    """A base mesh and its bytes. The fit trains on `vertices` and `faces`, so that storing loses nothing."""

    blob: bytes
    vertices: Float[Array, "v 3"]
    """float64, box frame: centred, longest side 3 exactly; exactly what the blob decodes to."""
    faces: Int[Array, "f 3"]
    """int32, in the blob's order."""
    center: Float[Array, "3"]
    """float64: x_input = x_box * scale + center."""
    scale: float
    bits: int
    placement: Placement | None = None
    """Where the vertices lie instead, on the surface that another asset's base mesh is fitted to."""

    @property
    def placed(self) -> Float[Array, "v 3"]:
        """float64, box frame: where the displacement starts from."""
        return self.vertices if self.placement is None else self.placement.positions


def encode_base_mesh(mesh: BaseMesh, bits: int = 12) -> EncodedBaseMesh:
    """Round a base mesh to `bits` bits along its longest side and encode it.

    Laws: each vertex moves by at most half a grid step along each axis; decoding the blob gives `vertices` and
    `faces` bit for bit; topology stays; no two vertices coincide, no triangle flips or loses its area, and no new
    self-intersection appears. Where `bits` do not allow this, more are taken, up to 16.

    Args:
        mesh: In input units.
        bits: 8 to 16; the grid step is the longest side over 2^bits - 1.

    Raises:
        BaseMeshError: 16 bits do not do either; the message says what fails.
    """
    before = topology(mesh.faces, len(mesh.vertices))
    crossings = len(self_intersections(mesh.vertices, mesh.faces))
    fault = ""
    for tried in range(bits, MAX_BITS + 1):
        encoded = _encode(mesh, tried, before, crossings)
        if isinstance(encoded, EncodedBaseMesh):
            return encoded
        fault = encoded
    raise BaseMeshError(
        f"the base mesh cannot be stored, even with {MAX_BITS} bits per coordinate: {fault}. "
        f"Its thinnest parts are too small for its extent; remove far-away or tiny parts of the input"
    )


def _encode(mesh: BaseMesh, bits: int, before: Topology, crossings: int) -> EncodedBaseMesh | str:
    """The encoded mesh, or what is wrong with it at so many bits."""
    low, side, steps = mesh.vertices.min(axis=0), longest_side(mesh.vertices), (1 << bits) - 1
    grid = np.rint((mesh.vertices - low) * (steps / side)).astype(np.int64)
    original = _order(grid)
    if (np.diff(grid[original], axis=0) == 0).all(axis=1).any():
        return "vertices coincide"
    blob = encode_integer_mesh(grid, mesh.faces, bits)
    try:
        vertices, faces = decode_base_mesh(blob, before.vertices, before.faces)
    except AssetError as error:
        return str(error)
    fault = _fault(mesh, vertices, faces, original, before, crossings)
    if fault:
        return fault
    step = side / steps
    return EncodedBaseMesh(blob, vertices, faces, low + 0.5 * grid.max(axis=0) * step, side / BOX_SIDE, bits)


def _fault(
    mesh: BaseMesh,
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    original: Int[Array, " v"],
    before: Topology,
    crossings: int,
) -> str:
    """What the decoded mesh has lost against `mesh`; empty when nothing."""
    try:
        check_base_mesh(
            BaseMesh(vertices, faces),
            closed=before.closed,
            euler_characteristic=before.euler_characteristic,
            components=before.components,
        )
    except BaseMeshError as error:
        return str(error)
    # Both sets of vertices, put in order of their coordinates, correspond.
    source = np.empty(len(vertices), dtype=np.int64)
    source[_order(vertices)] = original
    old, new = face_normals(mesh.vertices, source[faces]), face_normals(vertices, faces)
    turned = int((np.einsum("ij,ij->i", old, new) < MIN_COSINE * _length(old) * _length(new)).sum())
    if turned:
        return f"{turned} triangles flip"
    more = len(self_intersections(vertices, faces)) - crossings
    return f"{more} pairs of faces begin to intersect" if more > crossings * TOLERATED_CROSSINGS else ""


def _order(points: Float[Array, "v 3"] | Int[Array, "v 3"]) -> Int[Array, " v"]:
    return np.lexsort((points[:, 2], points[:, 1], points[:, 0]))


def _length(vectors: Float[Array, "f 3"]) -> Float[Array, " f"]:
    return np.linalg.norm(vectors, axis=1)
