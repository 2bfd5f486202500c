"""Triangle mesh writers: .ply, .obj, .stl, .off and .glb, by the file's suffix. Atomic, numpy only.

Precision: .ply, .obj and .off keep coordinates as float32 where that moves no vertex by more than 1e-6 of the longest
side, and as float64 otherwise. .glb stores float32 about the centre of the bounding box, which its node's translation
(a double in the JSON) puts back, under the same condition. .stl has float32 alone.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int, UInt8
from ndf_core.errors import OutputError
from ndf_core.files import atomic_write

Colors = UInt8[Array, "v 3"] | None
_CHUNK = 1 << 16
"""Lines of text that are formatted at a time."""


def write_mesh(
    path: Path | str,
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    colors: Colors = None,
    values: Mapping[str, Float[Array, " v"]] | None = None,
) -> None:
    """Write a triangle mesh; other processes see the old file or the whole new one.

    Args:
        path: Its suffix names the format.
        vertices: Written as they are, in their own units.
        faces: Indices into `vertices`.
        colors: Red, green and blue of each vertex, uint8.
        values: Further numbers of each vertex by name (of ASCII letters, digits and _), for .ply alone, as float32.

    Raises:
        OutputError: unknown suffix, vertices that are not finite, indices out of range, colours in an .stl, values in
            anything but a .ply, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise OutputError(f"cannot write {path}: {suffix or 'no'} suffix; use one of {', '.join(SUFFIXES)}")
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    corners = np.ascontiguousarray(faces, dtype=np.int32)
    if not np.isfinite(points).all():
        raise OutputError(f"cannot write {path}: the mesh has vertices that are not finite")
    if len(corners) and (corners.min() < 0 or corners.max() >= len(points)):
        raise OutputError(f"cannot write {path}: the mesh has a face that names a vertex that does not exist")
    if colors is not None and (colors.shape != points.shape or colors.dtype != np.uint8):
        raise OutputError(f"cannot write {path}: the colours are not one row of three uint8 for each vertex")
    if values and suffix != ".ply":
        raise OutputError(f"cannot write {path}: only a .ply holds values of vertices")
    with atomic_write(path) as file:
        if suffix == ".ply":
            _write_ply(file, points, corners, colors, values or {})
        else:
            _WRITERS[suffix](file, points, corners, colors)


def _single_precision_does(points: Float[Array, "v 3"]) -> bool:
    """Whether float32 moves no coordinate by more than 1e-6 of the longest side."""
    if not len(points):
        return True
    side = float((points.max(axis=0) - points.min(axis=0)).max())
    with np.errstate(over="ignore"):
        moved = np.abs(points - points.astype(np.float32)).max()
    return bool(moved <= 1e-6 * side)


def _write_ply(
    file: BinaryIO,
    points: Float[Array, "v 3"],
    corners: Int[Array, "f 3"],
    colors: Colors,
    values: Mapping[str, Float[Array, " v"]],
) -> None:
    single = _single_precision_does(points)
    fields: list[Any] = [("position", "<f4" if single else "<f8", 3)]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    lines += [f"property {'float' if single else 'double'} {axis}" for axis in "xyz"]
    if colors is not None:
        fields.append(("color", "u1", 3))
        lines += [f"property uchar {name}" for name in ("red", "green", "blue")]
    fields += [(f"value {name}", "<f4") for name in values]
    lines += [f"property float {name}" for name in values]
    lines += [f"element face {len(corners)}", "property list uchar int vertex_indices", "end_header", ""]
    vertex = np.empty(len(points), fields)
    vertex["position"] = points
    if colors is not None:
        vertex["color"] = colors
    for name, numbers in values.items():
        vertex[f"value {name}"] = numbers
    face = np.empty(len(corners), [("count", "u1"), ("corners", "<i4", 3)])
    face["count"], face["corners"] = 3, corners
    file.write("\n".join(lines).encode("ascii"))
    file.write(vertex.tobytes())
    file.write(face.tobytes())


def _write_obj(file: BinaryIO, points: Float[Array, "v 3"], corners: Int[Array, "f 3"], colors: Colors) -> None:
    number = _number_format(points)
    if colors is None:
        _write_lines(file, f"v {number} {number} {number}\n", points)
    else:
        # Not in the original format, but what most programs write and read.
        _write_lines(file, f"v {number} {number} {number} %.4f %.4f %.4f\n", np.hstack([points, colors / 255.0]))
    _write_lines(file, "f %d %d %d\n", corners.astype(np.int64) + 1)


def _write_off(file: BinaryIO, points: Float[Array, "v 3"], corners: Int[Array, "f 3"], colors: Colors) -> None:
    number = _number_format(points)
    file.write(f"{'OFF' if colors is None else 'COFF'}\n{len(points)} {len(corners)} 0\n".encode("ascii"))
    if colors is None:
        _write_lines(file, f"{number} {number} {number}\n", points)
    else:
        _write_lines(file, f"{number} {number} {number} %d %d %d 255\n", np.hstack([points, colors]))
    _write_lines(file, "3 %d %d %d\n", corners)


def _number_format(points: Float[Array, "v 3"]) -> str:
    """Digits that give back the same float32, or the same float64 where float32 does not do."""
    return "%.9g" if _single_precision_does(points) else "%.17g"


def _write_lines(file: BinaryIO, line: str, rows: Array) -> None:
    """One line of text for each row: one formatting operation for many lines is what makes this fast."""
    for start in range(0, len(rows), _CHUNK):
        part = rows[start : start + _CHUNK]
        file.write(((line * len(part)) % tuple(part.ravel().tolist())).encode("ascii"))


def _write_stl(file: BinaryIO, points: Float[Array, "v 3"], corners: Int[Array, "f 3"], colors: Colors) -> None:
    if colors is not None:
        raise OutputError("cannot write colours to an .stl file; use .ply, .obj, .off or .glb")
    triangle = points[corners]
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    record = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
    record["normal"] = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    record["corners"] = triangle
    file.write(b"binary STL written by ndf".ljust(80))
    file.write(struct.pack("<I", len(corners)))
    file.write(record.tobytes())


def _write_glb(file: BinaryIO, points: Float[Array, "v 3"], corners: Int[Array, "f 3"], colors: Colors) -> None:
    node: dict[str, Any] = {"mesh": 0}
    if not _single_precision_does(points):
        center = (points.max(axis=0) + points.min(axis=0)) / 2
        node["translation"] = center.tolist()
        points = points - center
    position = points.astype("<f4")
    blobs = [position.tobytes(), corners.astype("<u4").tobytes()]
    accessors: list[dict[str, Any]] = [
        {"componentType": 5126, "type": "VEC3", "count": len(points)} | _bounds(position),
        {"componentType": 5125, "type": "SCALAR", "count": corners.size},
    ]
    attributes = {"POSITION": 0}
    if colors is not None:
        opaque = np.full((len(colors), 1), 255, np.uint8)  # rows of four bytes, as the format's alignment wants
        blobs.append(np.hstack([colors, opaque]).tobytes())
        accessors.append({"componentType": 5121, "type": "VEC4", "count": len(colors), "normalized": True})
        attributes["COLOR_0"] = 2
    primitive = {"attributes": attributes, "indices": 1}
    document = {
        "asset": {"version": "2.0", "generator": "ndf"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [accessor | {"bufferView": i} for i, accessor in enumerate(accessors)],
        "bufferViews": list(_buffer_views(blobs)),
        "buffers": [{"byteLength": sum(len(blob) for blob in blobs)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text = text.ljust((len(text) + 3) // 4 * 4)
    binary = sum(len(blob) for blob in blobs)
    file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + binary))
    file.write(struct.pack("<I4s", len(text), b"JSON") + text)
    file.write(struct.pack("<I4s", binary, b"BIN\0") + b"".join(blobs))


def _bounds(position: Float[Array, "v 3"]) -> dict[str, list[float]]:
    if not len(position):
        return {}
    return {"min": position.min(axis=0).tolist(), "max": position.max(axis=0).tolist()}


def _buffer_views(blobs: list[bytes]) -> Iterator[dict[str, int]]:
    """Positions and colours are vertex data (target 34962), the second blob indices (34963)."""
    offset = 0
    for i, blob in enumerate(blobs):
        yield {"buffer": 0, "byteOffset": offset, "byteLength": len(blob), "target": 34963 if i == 1 else 34962}
        offset += len(blob)


_WRITERS: dict[str, Callable[[BinaryIO, Array, Array, Colors], None]] = {
    ".obj": _write_obj,
    ".stl": _write_stl,
    ".glb": _write_glb,
    ".off": _write_off,
}
SUFFIXES = (".ply", *_WRITERS)
