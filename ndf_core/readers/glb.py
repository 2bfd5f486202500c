"""GLB (glTF 2.0, binary): the triangles of the scene, with the transforms of its nodes applied.

Only the file's own binary chunk is read; nothing that it refers to by a URI, no textures, no animation.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.readers.gltf_accessor import Buffer, accessor_count, accessor_shape, read_accessor
from ndf_core.readers.gltf_scene import placed_meshes
from ndf_core.readers.polygons import RawMesh, strip_triangles

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_SURFACES = (_TRIANGLES, _STRIP, _FAN)
_MOST_ELEMENTS = 10_000_000
"""Of vertices and corners of triangles in files with fewer bytes than that."""
_UNDERSTOOD = ("KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_punctual")


def read_glb(data: bytes) -> RawMesh:
    """Read all triangles of the default scene.

    Raises:
        ValueError: the file is not valid, or needs something that is not read here.
    """
    buffer, surfaces, notes = _surfaces(data)
    vertices, faces, offset = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for primitive, matrix in surfaces:
        points, triangles = _primitive(buffer, primitive)
        # A transform that mirrors turns triangles over.
        triangles = triangles[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else triangles
        if len(triangles) and not (triangles.min() >= 0 and triangles.max() < len(points)):
            raise ValueError("a triangle names a vertex that does not exist")
        vertices.append(_placed(points, matrix))
        faces.append(triangles + offset)
        offset += len(points)
    return RawMesh(np.concatenate(vertices), np.concatenate(faces), notes)


def read_glb_colors(data: bytes) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]] | None:
    """Vertices with colours, in the scene, and their colours; None where there are none.

    Raises:
        ValueError: the file is not valid.
    """
    buffer, surfaces, _ = _surfaces(data)
    points, colors = list[Array](), list[Array]()
    for primitive, matrix in surfaces:
        index = primitive["attributes"].get("COLOR_0")
        if index is None:
            continue
        shape = "VEC4" if accessor_shape(buffer, index) == "VEC4" else "VEC3"
        here = read_accessor(buffer, primitive["attributes"]["POSITION"], "VEC3").astype(np.float64)
        seen = read_accessor(buffer, index, shape).astype(np.float64)[:, :3]
        if len(seen) != len(here):
            raise ValueError("a mesh has another number of colours than of vertices")
        points.append(_placed(here, matrix))
        colors.append(seen)
    return (np.concatenate(points), np.concatenate(colors)) if points else None


def _surfaces(data: bytes) -> tuple[Buffer, list[tuple[dict[str, Any], Array]], tuple[str, ...]]:
    """The primitives that have triangles, with their transforms, and a note on the others."""
    document, binary = _chunks(data)
    required = document.get("extensionsRequired", [])
    foreign = [name for name in required if not str(name).startswith(_UNDERSTOOD)]
    if foreign:
        raise ValueError(f"it needs {', '.join(map(str, foreign))!s:.200}, which is not read; export it uncompressed")
    buffer = Buffer(document, binary)
    placed = [
        (primitive, matrix) for mesh, matrix in placed_meshes(document) for primitive in mesh.get("primitives", [])
    ]
    surfaces = [(primitive, matrix) for primitive, matrix in placed if primitive.get("mode", _TRIANGLES) in _SURFACES]
    notes = (
        (f"{len(placed) - len(surfaces)} sets of points or lines left out",) if len(surfaces) < len(placed) else ()
    )
    _check_total(buffer, [primitive for primitive, _ in surfaces], len(data))
    return buffer, surfaces, notes


def _placed(points: Float[Array, "n 3"], matrix: Float[Array, "4 4"]) -> Float[Array, "n 3"]:
    with np.errstate(invalid="ignore"):  # infinite coordinates are refused later, with the vertex
        return points @ matrix[:3, :3].T + matrix[:3, 3]


def _check_total(buffer: Buffer, primitives: list[dict[str, Any]], file_size: int) -> None:
    """Refuse scenes that would grow far beyond their file by placing the same mesh very often."""
    total = 0
    for primitive in primitives:
        used = [primitive["attributes"]["POSITION"], *([primitive["indices"]] if "indices" in primitive else [])]
        total += sum(accessor_count(buffer, index) for index in used)
        if total > max(file_size, _MOST_ELEMENTS):
            raise ValueError(f"its scene has more than {_MOST_ELEMENTS:,} vertices and corners, copies counted")


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON document and the binary chunk, which may be missing."""
    if len(data) < 20:
        raise ValueError("it is shorter than the header of a GLB file")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise ValueError(f"it is glTF {version}; only version 2 is read")
    if length > len(data):
        raise ValueError(f"the header announces {length:,} bytes, but the file has {len(data):,}; it is cut off")
    position, chunks = 12, {}
    while position + 8 <= length:
        size, kind = struct.unpack_from("<II", data, position)
        if position + 8 + size > length:
            raise ValueError("one of its parts is longer than the file")
        chunks.setdefault(kind, data[position + 8 : position + 8 + size])
        position += 8 + size
    try:
        document = json.loads(chunks.get(_JSON, b"").decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError("its description is not valid JSON") from error
    if not isinstance(document, dict):
        raise ValueError("its description is not a JSON object")
    return document, chunks.get(_BINARY, b"")


def _primitive(buffer: Buffer, primitive: dict[str, Any]) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"]]:
    points = read_accessor(buffer, primitive["attributes"]["POSITION"], "VEC3").astype(np.float64)
    if "indices" in primitive:
        corners = read_accessor(buffer, primitive["indices"], "SCALAR").astype(np.int64)
    else:
        corners = np.arange(len(points))
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _STRIP:
        return points, strip_triangles(corners)
    if mode == _FAN:
        middle = np.full(max(0, len(corners) - 2), corners[0] if len(corners) else 0)
        return points, np.stack([middle, corners[1:-1], corners[2:]], axis=1)
    if len(corners) % 3:
        raise ValueError(f"its {len(corners):,} corners are no whole number of triangles")
    return points, corners.reshape(-1, 3)
