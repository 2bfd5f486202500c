"""Broken and hostile mesh files: one clear error each, or a mesh; never a traceback, much memory or much time."""

from __future__ import annotations

import json
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mesh_files import FORMATS, ascii_ply, ball, chunks, gltf, obj, off, ply, ply_header, stl
from ndf_plugin_sdf.mesh import MeshConfig, sniff
from ndf_plugin_sdf.mesh_surface import open_mesh

from ndf_core.errors import InputError

SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb")
MIB = 1 << 20


@pytest.fixture(autouse=True)
def _bounded() -> Iterator[None]:
    """Every test here stays under 5 s of CPU and 64 MiB: what headers announce must not be allocated."""
    tracemalloc.start()
    before = time.process_time()
    yield
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 64 * MIB
    assert time.process_time() - before < 5.0


def check_refused(folder: Path, data: bytes, name: str) -> str:
    """The one clear error that a file gives."""
    path = folder / name
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        open_mesh(path, MeshConfig())
    message = str(caught.value)
    assert name in message
    assert len(message.splitlines()) == 1
    assert len(message) < 700
    return message


def check_refused_or_read(folder: Path, data: bytes, name: str) -> None:
    path = folder / name
    path.write_bytes(data)
    sniff(path)
    try:
        open_mesh(path, MeshConfig())
    except InputError as error:
        assert name in str(error)
        assert len(str(error).splitlines()) == 1


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_file_and_directory(tmp_path: Path, suffix: str) -> None:
    assert "empty" in check_refused(tmp_path, b"", f"a{suffix}")
    folder = tmp_path / f"folder{suffix}"
    folder.mkdir()
    assert sniff(folder) is None
    with pytest.raises(InputError, match="is a directory"):
        open_mesh(folder, MeshConfig())
    with pytest.raises(InputError, match="No such file"):
        open_mesh(tmp_path / f"none{suffix}", MeshConfig())


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("seed", range(4))
def test_binary_noise(tmp_path: Path, suffix: str, seed: int) -> None:
    noise = np.random.default_rng(seed).bytes(10 ** (seed + 1))
    check_refused(tmp_path, noise, f"noise{suffix}")
    found = sniff(tmp_path / f"noise{suffix}")
    assert found is not None
    assert found.confidence == 0.3


MAGIC = {
    ".obj": b"v 0 0 0\nf 1 1 1\n",
    ".ply": b"ply\nformat ascii 1.0\n",
    ".stl": b"solid\nfacet",
    ".off": b"OFF\n",
    ".glb": b"glTF",
}


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("seed", range(3))
def test_noise_after_the_right_beginning(tmp_path: Path, suffix: str, seed: int) -> None:
    check_refused(tmp_path, MAGIC[suffix] + np.random.default_rng(seed).bytes(3000), f"noise{suffix}")


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("tenths", range(10))
def test_truncated_files(tmp_path: Path, name: str, tenths: int) -> None:
    suffix, write = FORMATS[name]
    data = write(*ball())
    check_refused(tmp_path, data[: len(data) * tenths // 10], f"cut{suffix}")


@pytest.mark.parametrize("name", FORMATS)
def test_flipped_bytes(tmp_path: Path, name: str) -> None:
    suffix, write = FORMATS[name]
    data = np.frombuffer(write(*ball(1)), np.uint8)
    rng = np.random.default_rng(0)
    for _ in range(60):
        changed = data.copy()
        # Half of them in the header, where they hurt.
        places = rng.integers(0, len(data) if rng.random() < 0.5 else min(300, len(data)), 3)
        changed[places] = rng.integers(0, 256, 3)
        check_refused_or_read(tmp_path, changed.tobytes(), f"flipped{suffix}")


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_vertices_that_are_not_finite(tmp_path: Path, name: str, value: float) -> None:
    suffix, write = FORMATS[name]
    vertices, faces = ball()
    vertices[17, 1] = value
    assert "not finite" in check_refused(tmp_path, write(vertices, faces), f"a{suffix}")


INDEXED = [name for name in FORMATS if "stl" not in name]


@pytest.mark.parametrize("name", INDEXED)
@pytest.mark.parametrize("index", [162, 163, 10**6, 2**31 - 1])
def test_indices_out_of_range(tmp_path: Path, name: str, index: int) -> None:
    suffix, write = FORMATS[name]
    vertices, faces = ball()
    assert len(vertices) == 162
    faces = faces.astype(np.int64)
    faces[5, 2] = index
    assert "vert" in check_refused(tmp_path, write(vertices, faces), f"a{suffix}")


@pytest.mark.parametrize("name", ["off", "ply", "text ply", "big-endian ply"])
def test_negative_indices(tmp_path: Path, name: str) -> None:
    suffix, write = FORMATS[name]
    vertices, faces = ball()
    faces[5, 2] = -3
    assert "do not exist" in check_refused(tmp_path, write(vertices, faces), f"a{suffix}")


@pytest.mark.parametrize(
    "text", ["f 0 1 2", "f -9 1 2", "f 1 2 x", "f 1 2", "f 1 2 99999999999999999999", "f 1.5 2 3"]
)
def test_obj_faces_that_make_no_sense(tmp_path: Path, text: str) -> None:
    check_refused(tmp_path, f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{text}\n".encode(), "a.obj")


@pytest.mark.parametrize("name", FORMATS)
def test_no_faces(tmp_path: Path, name: str) -> None:
    suffix, write = FORMATS[name]
    message = check_refused(tmp_path, write(ball()[0], np.zeros((0, 3), np.int64)), f"a{suffix}")
    assert "no triangles" in message or "no faces" in message


@pytest.mark.parametrize("name", FORMATS)
def test_no_vertices_and_no_faces(tmp_path: Path, name: str) -> None:
    suffix, write = FORMATS[name]
    check_refused(tmp_path, write(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), f"a{suffix}")


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(
    "count", ["2147483648", "4294967296", "999999999999", "-1", "162.5", "1e9", "99999999999999999999", ""]
)
def test_ply_headers_with_lying_counts(tmp_path: Path, kind: str, count: str) -> None:
    vertices, faces = ball()
    whole = ascii_ply(vertices, faces) if kind == "ascii" else ply(vertices, faces, ">" if "big" in kind else "<")
    body = whole[whole.index(b"end_header\n") + 11 :]
    check_refused(tmp_path, ply_header(kind, count, len(faces)) + body, "a.ply")
    check_refused(tmp_path, ply_header(kind, len(vertices), count) + body, "a.ply")


@pytest.mark.parametrize(("vertices", "faces"), [(163, 320), (161, 320), (162, 321), (162, 330)])
def test_ply_headers_that_are_off_by_a_few(tmp_path: Path, vertices: int, faces: int) -> None:
    for whole in (ascii_ply(*ball()), ply(*ball())):
        kind = "ascii" if b"ascii" in whole else "binary_little_endian"
        body = whole[whole.index(b"end_header\n") + 11 :]
        check_refused(tmp_path, ply_header(kind, vertices, faces) + body, "a.ply")


@pytest.mark.parametrize("length", [b"\xff", b"\x00", b"\x01", b"\x02", b"\x04"])
def test_ply_lists_with_lying_lengths(tmp_path: Path, length: bytes) -> None:
    data = bytearray(ply(*ball()))
    first_face = data.index(b"end_header\n") + 11 + 162 * 24
    for row in (0, 1, 319):
        changed = data.copy()
        changed[first_face + 13 * row : first_face + 13 * row + 1] = length
        check_refused(tmp_path, bytes(changed), "a.ply")


@pytest.mark.parametrize(
    "header",
    [
        "ply\nend_header\n",
        "ply\nformat ascii 2.0\nend_header\n",
        "ply\nformat ascii 1.0\nproperty float x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty quaternion x\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex\nend_header\n",
        "ply\nformat ascii 1.0\nelement face 1000000000\nend_header\n",
        "ply\nformat ascii 1.0\nelement face 1\nproperty list float int vertex_indices\nend_header\n3 0 1 2\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n0\n3 0 0 0\n",
        "ply\nformat ascii 1.0\n" + "comment x\n" * 10_000,
    ],
)
def test_ply_headers_that_are_wrong(tmp_path: Path, header: str) -> None:
    check_refused(tmp_path, header.encode(), "a.ply")


@pytest.mark.parametrize("count", [0, 1, 319, 321, 2**31, 2**32 - 1])
def test_stl_headers_with_lying_counts(tmp_path: Path, count: int) -> None:
    data = bytearray(stl(*ball()))
    data[80:84] = count.to_bytes(4, "little")
    assert f"announces {count:,} triangles" in check_refused(tmp_path, bytes(data), "a.stl")


@pytest.mark.parametrize(
    "counts", ["2147483648 320 0", "162 2147483648 0", "-1 320 0", "162 -1 0", "x y z", "162", "1.5 2 3", "162 321 0"]
)
def test_off_headers_with_lying_counts(tmp_path: Path, counts: str) -> None:
    check_refused(tmp_path, off(*ball()).replace(b"162 320 0", counts.encode()), "a.off")


GLB_CHANGES = {
    "count": lambda d: d["accessors"][0].update(count=2**31),
    "negative count": lambda d: d["accessors"][0].update(count=-1),
    "real count": lambda d: d["accessors"][0].update(count=1.5),
    "true count": lambda d: d["accessors"][0].update(count=True),
    "no count": lambda d: d["accessors"][0].pop("count"),
    "no view, all zeros": lambda d: (d["accessors"][0].pop("bufferView"), d["accessors"][0].update(count=2**40)),
    "sparse": lambda d: d["accessors"][0].update(sparse={"count": 2**40}),
    "offset": lambda d: d["bufferViews"][0].update(byteOffset=2**40),
    "negative offset": lambda d: d["bufferViews"][0].update(byteOffset=-8),
    "stride": lambda d: d["bufferViews"][0].update(byteStride=1),
    "zero stride": lambda d: d["bufferViews"][0].update(byteStride=0),
    "other buffer": lambda d: d["bufferViews"][0].update(buffer=1),
    "type": lambda d: d["accessors"][0].update(type="MAT4"),
    "component": lambda d: d["accessors"][0].update(componentType=1),
    "unhashable component": lambda d: d["accessors"][0].update(componentType=[]),
    "index": lambda d: d["meshes"][0]["primitives"][0].update(indices=99),
    "text index": lambda d: d["meshes"][0]["primitives"][0].update(indices="0"),
    "no attributes": lambda d: d["meshes"][0]["primitives"][0].pop("attributes"),
    "attributes": lambda d: d["meshes"][0]["primitives"][0].update(attributes=[1]),
    "no position": lambda d: d["meshes"][0]["primitives"][0].update(attributes={}),
    "primitives": lambda d: d["meshes"][0].update(primitives=7),
    "meshes": lambda d: d.update(meshes={"0": {}}),
    "cycle": lambda d: d.update(nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}]),
    "own child": lambda d: d.update(nodes=[{"mesh": 0, "children": [0]}]),
    "two parents": lambda d: d.update(nodes=[{"children": [1, 1]}, {"mesh": 0}]),
    "no such child": lambda d: d.update(nodes=[{"mesh": 0, "children": [5]}]),
    "children": lambda d: d.update(nodes=[{"mesh": 0, "children": 5}]),
    "no such mesh": lambda d: d.update(nodes=[{"mesh": 3}]),
    "no such scene": lambda d: d.update(scene=9),
    "matrix": lambda d: d.update(nodes=[{"mesh": 0, "matrix": [1, 2, 3]}]),
    "huge matrix": lambda d: d.update(nodes=[{"mesh": 0, "matrix": [1e300] * 16}]),
    "text matrix": lambda d: d.update(nodes=[{"mesh": 0, "matrix": ["1"] * 16}]),
    "zero rotation": lambda d: d.update(nodes=[{"mesh": 0, "rotation": [0, 0, 0, 0]}]),
    "zero scale": lambda d: d.update(nodes=[{"mesh": 0, "scale": [0, 0, 0]}]),
    "compressed": lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]),
    "lines": lambda d: d["meshes"][0]["primitives"][0].update(mode=1),
    "only points": lambda d: d["meshes"][0]["primitives"][0].update(mode=0),
}  # fmt: skip


@pytest.mark.parametrize("change", GLB_CHANGES)
def test_glb_descriptions_that_lie(tmp_path: Path, change: str) -> None:
    document, binary = gltf(*ball())
    GLB_CHANGES[change](document)
    check_refused(tmp_path, chunks(document, binary), "a.glb")


@pytest.mark.parametrize(
    "text", [b"", b"[]", b"7", b"{", b"[" * 100_000, b'{"meshes": [' + b"9" * 5000 + b"]}", b"\xff\xfe"]
)
def test_glb_descriptions_that_are_no_json_objects(tmp_path: Path, text: bytes) -> None:
    check_refused(tmp_path, chunks(text, b""), "a.glb")


def test_glb_instances_are_bounded(tmp_path: Path) -> None:
    """A small file whose 2,000 nodes would make 40 million triangles."""
    document, binary = gltf(*ball(5))
    document["nodes"] = [{"mesh": 0}] * 2_000
    document["scenes"] = [{"nodes": list(range(2_000))}]
    assert "copies counted" in check_refused(tmp_path, chunks(document, binary), "a.glb")


def test_glb_lengths_that_lie(tmp_path: Path) -> None:
    data = bytearray(chunks(*gltf(*ball())))
    for place in (8, 12):
        for value in (2**32 - 1, 0, 13):
            changed = data.copy()
            changed[place : place + 4] = value.to_bytes(4, "little")
            check_refused(tmp_path, bytes(changed), "a.glb")


def test_names_and_references_are_never_followed(tmp_path: Path) -> None:
    secret = tmp_path / "secret.mtl"
    secret.write_text("newmtl a\n")
    data = b"mtllib secret.mtl\nmtllib /etc/passwd\n" + obj(*ball())
    (tmp_path / "a.obj").write_bytes(data)
    assert open_mesh(tmp_path / "a.obj", MeshConfig()).notes == ()
    document, binary = gltf(*ball())
    document["buffers"] = [{"uri": "secret.mtl", "byteLength": 10**9}]
    document["images"] = [{"uri": "file:///etc/passwd"}]
    (tmp_path / "a.glb").write_bytes(chunks(document, binary))
    assert open_mesh(tmp_path / "a.glb", MeshConfig()).notes == ()


def test_a_mesh_file_that_is_something_else(tmp_path: Path) -> None:
    assert "not a mesh file" in check_refused(tmp_path, b"hello", "a.txt")
    check_refused(tmp_path, json.dumps({"type": "sphere"}).encode(), "a.obj")
