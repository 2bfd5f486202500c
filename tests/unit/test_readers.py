"""Readers of mesh files against what was written, and against trimesh."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mesh_files import FORMATS, ball, by_trimesh, chunks, gltf, ply_header, torus
from ndf_plugin_sdf.mesh import sniff

from ndf_core.errors import InputError
from ndf_core.readers.mesh_file import read_mesh_file
from ndf_core.readers.polygons import RawMesh, fans, strip_triangles


def read(folder: Path, data: bytes, name: str = "file.bin") -> RawMesh:
    path = folder / name
    path.write_bytes(data)
    return read_mesh_file(path)


def corners(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return np.asarray(vertices)[np.asarray(faces)]


@pytest.mark.parametrize("name", FORMATS)
def test_what_was_written_is_read_and_trimesh_agrees(tmp_path: Path, name: str) -> None:
    suffix, write = FORMATS[name]
    vertices, faces = torus()
    data = write(vertices, faces)
    mesh = read(tmp_path, data)  # found by its content, whatever the name
    precision = 1e-6 if name in ("stl", "glb") else 0
    np.testing.assert_allclose(corners(mesh.vertices, mesh.faces), corners(vertices, faces), atol=precision)
    np.testing.assert_allclose(
        corners(mesh.vertices, mesh.faces), corners(*by_trimesh(data, suffix)), atol=precision or 1e-12
    )
    assert mesh.vertices.dtype == np.float64
    if "stl" not in name:
        np.testing.assert_array_equal(mesh.faces, faces)


@pytest.mark.parametrize("name", FORMATS)
def test_sniffing_looks_at_the_content(tmp_path: Path, name: str) -> None:
    path = tmp_path / "unnamed"
    path.write_bytes(FORMATS[name][1](*ball()))
    found = sniff(path)
    assert found is not None
    assert found.confidence == 0.6
    assert "triangle mesh" in found.reason


@pytest.mark.parametrize("kind", ["obj", "ply", "off", "stl", "glb"])
def test_what_trimesh_writes_is_read(tmp_path: Path, kind: str) -> None:
    source = trimesh.creation.annulus(0.5, 1.0, 2.0)
    data = source.export(file_type=kind)
    mesh = read(tmp_path, data if isinstance(data, bytes) else data.encode())
    np.testing.assert_allclose(corners(mesh.vertices, mesh.faces), source.triangles, atol=1e-6)


def test_real_files_agree_with_trimesh(tmp_path: Path, shared_data: Path) -> None:
    for name in ("spot.obj", "homer.obj", "3holes.off", "horse.ply", "trimesh_1002_tray_bottom.STL"):
        path = shared_data / "mesh" / name
        mesh = read_mesh_file(path)
        expected = by_trimesh(path.read_bytes(), path.suffix.lower())
        ours = corners(mesh.vertices, mesh.faces)
        theirs = corners(*expected)
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(np.sort(ours.sum(axis=1), axis=0), np.sort(theirs.sum(axis=1), axis=0), atol=1e-5)


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "f 1/1 3/2 2/3\nf 1/1/1 2/2/2 4/3/3\nf 1//1 4//2 3//3\nf 2 3 4\n",
        "f -4 -2 -3\nf -4 -3 -1\nf -4 -1 -2\nf -3 -2 -1\n",
        "f  1\t3 2  \r\nf 1 2 \\\n4\nf 1 4 3 # comment\n  f 2 3 4",
    ],
)
def test_obj_spellings(tmp_path: Path, faces: str) -> None:
    mesh = read(tmp_path, (TETRAHEDRON + "vt 0 0\nvn 0 0 1\ng group\nusemtl m\ns off\n" + faces).encode())
    np.testing.assert_array_equal(mesh.faces, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def test_obj_relative_indices_count_back_from_their_line(tmp_path: Path) -> None:
    """The vertices after the face do not count."""
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n" + "v 5 5 5\nv 6 5 5\nv 5 6 5\nf -3 -2 -1\n"
    np.testing.assert_array_equal(read(tmp_path, text.encode()).faces, [[0, 1, 2], [3, 4, 5]])


def test_obj_vertex_colours_are_skipped(tmp_path: Path) -> None:
    text = "v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 1\nf 1 2 3\n"
    np.testing.assert_array_equal(read(tmp_path, text.encode()).vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("kind", ["ascii", "binary"])
def test_ply_with_mixed_polygons_and_other_properties(tmp_path: Path, kind: str) -> None:
    header = (
        f"ply\nformat {'ascii' if kind == 'ascii' else 'binary_little_endian'} 1.0\nelement vertex 5\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\n"
        "element face 2\nproperty uchar flags\nproperty list uchar uint vertex_index\n"
        "element edge 1\nproperty int vertex1\nend_header\n"
    ).encode()
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)]
    if kind == "ascii":
        body = "".join(f"{x} {y} {z} 255\n" for x, y, z in points) + "7 4 0 1 2 3\n8 3 0 1 4\n1\n"
        data = header + body.encode()
    else:
        rows = np.array([(*p, 255) for p in points], dtype="<f4,<f4,<f4,u1").tobytes()
        quad = np.array([7, 4], "u1").tobytes() + np.array([0, 1, 2, 3], "<u4").tobytes()
        triangle = np.array([8, 3], "u1").tobytes() + np.array([0, 1, 4], "<u4").tobytes()
        data = header + rows + quad + triangle + np.array([1], "<i4").tobytes()
    mesh = read(tmp_path, data)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 4]])
    np.testing.assert_array_equal(mesh.vertices, points)
    assert mesh.notes == ("1 polygons cut into triangles",)


def test_ply_triangle_strips(tmp_path: Path) -> None:
    text = (
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 2 2\n8 0 1 2 3 -1 2 3 4\n"
    )
    np.testing.assert_array_equal(read(tmp_path, text.encode()).faces, [[0, 1, 2], [2, 1, 3], [2, 3, 4]])


def test_off_with_colours_comments_and_counts_on_the_first_line(tmp_path: Path) -> None:
    text = (
        "COFF 4 2 0 # counts\n\n0 0 0 255 0 0 255\n1 0 0 1 1 1 1\n# more\n1 1 0 0 0 0 0\n0 1 0 0 0 0 0\n"
        "4 0 1 2 3 9 9 9\n3 0 1 2\n"
    )
    mesh = read(tmp_path, text.encode())
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 2]])


def test_glb_scenes_are_concatenated_with_their_transforms(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0.2, 0.3])
    flip = np.diag([1.0, -2.0, 1.0, 1.0])
    scene.add_geometry(trimesh.creation.icosphere(subdivisions=1), node_name="a", geom_name="ball", transform=turn)
    scene.add_geometry(trimesh.creation.box(), node_name="b", geom_name="box", parent_node_name="a", transform=flip)
    data = scene.export(file_type="glb")
    mesh = read(tmp_path, data)
    expected = trimesh.load(io.BytesIO(data), file_type="glb", process=False).to_geometry()
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), expected.vertices.mean(axis=0), atol=1e-6)
    ours = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    # Mirrored parts stay outside out: the volumes add up.
    assert abs(ours.volume - (trimesh.creation.icosphere(subdivisions=1).volume + 2.0)) < 1e-5


def test_glb_nodes_translate_rotate_and_scale_in_gltf_order(tmp_path: Path) -> None:
    document, binary = gltf(*ball(1))
    half = np.sqrt(0.5)
    document["nodes"] = [
        {"children": [1], "translation": [1, 2, 3]},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 1, 1]},
    ]
    mesh = read(tmp_path, chunks(document, binary))
    extent = mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)
    np.testing.assert_allclose(extent, [2, 4, 2], atol=1e-6)  # the long x turned to y
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), [1, 2, 3], atol=1e-6)


def test_glb_quantised_positions(tmp_path: Path) -> None:
    vertices, faces = ball(1)
    document, _ = gltf(vertices, faces)
    points = np.round(vertices * 32767).astype("<i2")
    padded = np.zeros((len(points), 4), "<i2")
    padded[:, :3] = points
    document["accessors"][0] |= {"componentType": 5122, "normalized": True}
    document["bufferViews"][0] |= {"byteLength": padded.nbytes, "byteStride": 8}
    document["bufferViews"][1]["byteOffset"] = padded.nbytes
    document["extensionsRequired"] = ["KHR_mesh_quantization"]
    mesh = read(tmp_path, chunks(document, padded.tobytes() + np.asarray(faces, "<u4").tobytes()))
    np.testing.assert_allclose(mesh.vertices, vertices, atol=2e-5)


def test_point_clouds_are_not_claimed_and_refused_clearly(tmp_path: Path) -> None:
    cloud = ply_header("ascii", 2, 0) + b"0 0 0\n1 1 1\n"
    only_points = cloud.replace(b"element face 0\nproperty list uchar int vertex_indices\n", b"")
    for data, name in ((cloud, "a.ply"), (only_points, "b.ply"), (b"v 0 0 0\nv 1 1 1\n", "c.obj")):
        with pytest.raises(InputError, match="no faces|no triangles"):
            read(tmp_path, data, name)
        assert sniff(tmp_path / name) is None


def test_strips_and_fans() -> None:
    strip = np.array([0, 1, 2, 3, 4])
    np.testing.assert_array_equal(strip_triangles(strip), [[0, 1, 2], [2, 1, 3], [2, 3, 4]])
    triangles, notes = fans(np.arange(12), np.array([3, 5, 4]))
    np.testing.assert_array_equal(triangles, [[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 7], [8, 9, 10], [8, 10, 11]])
    assert notes == ("2 polygons cut into triangles",)
    with pytest.raises(ValueError, match="face 2 has 2 corners"):
        fans(np.arange(5), np.array([3, 2]))
