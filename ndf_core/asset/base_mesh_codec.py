"""The base mesh as bytes: integer coordinates through Draco, decoded to the same bits on every machine.

Draco dequantises in float32, whose rounding may depend on the platform. Here its grid has step 1, so that it hands
back integers, which are exact; the box frame follows from them in float64. Nothing beside the blob is needed: the
longest side of the integer box is 3 in the box frame, and its centre is the origin.
"""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.errors import AssetError

BOX_SIDE = 3.0
"""Longest side of the base mesh's bounding box in the box frame (App. A.1)."""
MIN_BITS, MAX_BITS = 8, 16
_MAGIC = b"DRACO\x02\x02\x01\x01\x00\x00"
"""Draco 2.2, triangle mesh, edgebreaker connectivity, no metadata: all that `encode_integer_mesh` writes."""
_HOSTILE = "the base mesh in the file cannot be decoded ({}); the file is damaged, ask for a new copy"


def encode_integer_mesh(coordinates: Int[Array, "v 3"], faces: Int[Array, "f 3"], bits: int) -> bytes:
    """Draco blob of a mesh whose coordinates are integers in [0, 2^bits - 1]. Draco reorders vertices and faces."""
    import DracoPy

    if not MIN_BITS <= bits <= MAX_BITS or coordinates.min() < 0 or coordinates.max() >= 1 << bits:
        raise ValueError(f"coordinates must lie in 0..{(1 << bits) - 1}, and bits in {MIN_BITS}..{MAX_BITS}")
    return DracoPy.encode(
        coordinates.astype(np.float32),
        faces.astype(np.uint32),
        quantization_bits=bits,
        compression_level=10,
        quantization_range=float((1 << bits) - 1),
        quantization_origin=np.zeros(3),
    )


def decode_base_mesh(
    blob: bytes, vertex_count: int, face_count: int
) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"]]:
    """Decode a blob of `encode_integer_mesh` into the box frame.

    Laws: the same bytes give the same bits everywhere; the bounding box is centred at the origin and its longest
    side is 3 exactly. The topology is not checked here.

    Args:
        blob: From outside, so every size is checked before Draco allocates for it.
        vertex_count: What the file's header says; anything else in the blob is an error.
        face_count: The same.

    Returns:
        Vertices (float64, box frame) and faces (int32).

    Raises:
        AssetError: the blob is not such a mesh, or not of these sizes.
    """
    coordinates, faces = _decode_integers(blob, vertex_count, face_count)
    return box_frame(coordinates), faces


def box_frame(coordinates: Int[Array, "v 3"]) -> Float[Array, "v 3"]:
    """Integer coordinates, each axis starting at 0, in the box frame: centred, longest side 3."""
    sides = coordinates.max(axis=0)
    # Twice the offset from the centre is an integer, so there is one rounding each for the product and the quotient.
    return (2 * coordinates - sides).astype(np.float64) * (BOX_SIDE / 2) / float(sides.max())


def _decode_integers(blob: bytes, vertex_count: int, face_count: int) -> tuple[Int[Array, "v 3"], Int[Array, "f 3"]]:
    import DracoPy

    _check_header(blob, vertex_count, face_count)
    try:
        mesh = DracoPy.decode(blob)
        points, faces = np.asarray(mesh.points), np.asarray(mesh.faces)
    except Exception as error:  # Draco's wrapper raises several unrelated classes
        raise AssetError(_HOSTILE.format(error)) from error
    if points.shape != (vertex_count, 3) or faces.shape != (face_count, 3):
        raise AssetError(_HOSTILE.format(f"{points.shape} vertices, {faces.shape} faces"))
    if not np.isfinite(points).all() or (points < 0).any() or (points >= 1 << MAX_BITS).any():
        raise AssetError(_HOSTILE.format("coordinates out of range"))
    coordinates = points.astype(np.int64)
    if (coordinates != points).any() or coordinates.min(axis=0).any() or not coordinates.any():
        raise AssetError(_HOSTILE.format("coordinates are not on the grid"))
    if faces.min() < 0 or faces.max() >= vertex_count:
        raise AssetError(_HOSTILE.format("a face names a vertex that does not exist"))
    return coordinates, faces.astype(np.int32)


def _check_header(blob: bytes, vertex_count: int, face_count: int) -> None:
    """Compare the sizes that Draco would allocate for with the expected ones."""
    if vertex_count < 3 or face_count < 1 or not blob.startswith(_MAGIC):
        raise AssetError(_HOSTILE.format("no mesh of a known kind"))
    at = len(_MAGIC) + 1  # one byte says how the connectivity is traversed
    vertices, at = _varint(blob, at)
    faces, at = _varint(blob, at)
    if vertices != vertex_count or faces != face_count:
        raise AssetError(
            _HOSTILE.format(
                f"{vertices} vertices and {faces} faces where {vertex_count} and {face_count} are expected"
            )
        )


def _varint(blob: bytes, at: int) -> tuple[int, int]:
    """Little-endian base-128 number at `at`, and the position after it."""
    value = 0
    for shift in range(0, 35, 7):
        if at >= len(blob):
            break
        byte = blob[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
    raise AssetError(_HOSTILE.format("truncated"))
