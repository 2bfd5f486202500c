"""Small closed meshes and the bytes of files that hold them."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable

import numpy as np
import trimesh

Mesh = tuple[np.ndarray, np.ndarray]


def ball(subdivisions: int = 2, radius: float = 1.0, center: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return np.array(sphere.vertices) + center, np.array(sphere.faces)


def torus() -> Mesh:
    ring = trimesh.creation.torus(1.0, 0.35, major_sections=24, minor_sections=12)
    return np.array(ring.vertices), np.array(ring.faces)


def cube() -> Mesh:
    box = trimesh.creation.box(extents=(2, 2, 2))
    return np.array(box.vertices), np.array(box.faces)


def together(*meshes: Mesh) -> Mesh:
    offsets = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    return np.concatenate([v for v, _ in meshes]), np.concatenate(
        [f + n for (_, f), n in zip(meshes, offsets, strict=True)]
    )


def obj(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces.tolist()]
    return "\n".join(["# made by a test", *lines, ""]).encode()


def off(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"{len(face)} " + " ".join(map(str, face)) for face in faces.tolist()]
    return "\n".join([*lines, ""]).encode()


def ply_header(kind: str, vertices: int | str, faces: int | str, real: str = "double") -> bytes:
    return (
        f"ply\nformat {kind} 1.0\ncomment made by a test\nelement vertex {vertices}\n"
        f"property {real} x\nproperty {real} y\nproperty {real} z\nelement face {faces}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()


def ply(vertices: np.ndarray, faces: np.ndarray, order: str = "<") -> bytes:
    kind = "binary_little_endian" if order == "<" else "binary_big_endian"
    rows = np.empty(len(faces), dtype=[("n", "u1"), ("i", order + "i4", 3)])
    rows["n"], rows["i"] = 3, faces
    body = np.asarray(vertices, order + "f8").tobytes() + rows.tobytes()
    return ply_header(kind, len(vertices), len(faces)) + body


def big_endian_ply(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    return ply(vertices, faces, ">")


def ascii_ply(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"{len(face)} " + " ".join(map(str, face)) for face in faces.tolist()]
    return ply_header("ascii", len(vertices), len(faces)) + "\n".join([*lines, ""]).encode()


def stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    rows = np.zeros(len(faces), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = vertices[faces]
    return b"solid is no reason to take this for text".ljust(80) + struct.pack("<I", len(faces)) + rows.tobytes()


def ascii_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["solid test"]
    for corners in vertices[faces].tolist():
        lines += [" facet normal 0 0 0", "  outer loop"]
        lines += [f"   vertex {x!r} {y!r} {z!r}" for x, y, z in corners]
        lines += ["  endloop", " endfacet"]
    return "\n".join([*lines, "endsolid test", ""]).encode()


def chunks(document: object, binary: bytes) -> bytes:
    """A GLB file from its two parts."""
    text = document if isinstance(document, bytes) else json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def gltf(vertices: np.ndarray, faces: np.ndarray) -> tuple[dict, bytes]:
    """The parts of a GLB file with one mesh in one node."""
    points, corners = np.asarray(vertices, "<f4").tobytes(), np.asarray(faces, "<u4").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(points) + len(corners)}],
    }
    return document, points + corners


def glb(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    return chunks(*gltf(vertices, faces))


FORMATS: dict[str, tuple[str, Callable[[np.ndarray, np.ndarray], bytes]]] = {
    "obj": (".obj", obj),
    "off": (".off", off),
    "ply": (".ply", ply),
    "big-endian ply": (".ply", big_endian_ply),
    "text ply": (".ply", ascii_ply),
    "stl": (".stl", stl),
    "text stl": (".stl", ascii_stl),
    "glb": (".glb", glb),
}


def by_trimesh(data: bytes, suffix: str) -> Mesh:
    """The same file through another reader."""
    loaded = trimesh.load(io.BytesIO(data), file_type=suffix[1:], process=False, force="mesh")
    return np.array(loaded.vertices), np.array(loaded.faces)
