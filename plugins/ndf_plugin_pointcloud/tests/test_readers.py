"""Readers of point files: what is right is read, what is hostile is one clear error, and nothing takes memory."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from ndf_plugin_pointcloud import oriented_points, points, soup
from ndf_plugin_pointcloud.detect import look
from ndf_plugin_pointcloud.lzf import decompress
from ndf_plugin_pointcloud.point_file import read_point_file

from ndf_core.api import RepresentationSpec
from ndf_core.errors import InputError

RNG = np.random.default_rng(0)
POINTS = RNG.standard_normal((60, 3)).astype(np.float32).astype(np.float64)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
BOTH = np.concatenate([POINTS, NORMALS], axis=1)


def literal_lzf(data: bytes) -> bytes:
    """LZF that repeats nothing."""
    parts = [data[i : i + 32] for i in range(0, len(data), 32)]
    return b"".join(bytes([len(part) - 1]) + part for part in parts)


def text(rows: np.ndarray, separator: str = " ") -> bytes:
    return "\n".join(separator.join(f"{x:.9g}" for x in row) for row in rows).encode() + b"\n"


def ply(rows: np.ndarray, kind: str) -> bytes:
    names = ["x", "y", "z", "nx", "ny", "nz"][: rows.shape[1]]
    header = f"ply\nformat {kind} 1.0\nelement vertex {len(rows)}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    order = {"binary_little_endian": "<f4", "binary_big_endian": ">f4"}.get(kind)
    return header.encode() + (rows.astype(order).tobytes() if order else text(rows))


def pcd(rows: np.ndarray, kind: str) -> bytes:
    names = ["x", "y", "z", "normal_x", "normal_y", "normal_z"][: rows.shape[1]]
    n = len(names)
    header = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {' '.join(names)}\nSIZE {' '.join('4' * n)}\nTYPE {' '.join('F' * n)}\n"
        f"COUNT {' '.join('1' * n)}\nWIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(rows)}\n"
        f"DATA {kind}\n"
    ).encode()
    if kind == "ascii":
        return header + text(rows)
    if kind == "binary":
        return header + rows.astype("<f4").tobytes()
    raw = rows.T.astype("<f4").tobytes()
    packed = literal_lzf(raw)
    return header + np.array([len(packed), len(raw)], "<u4").tobytes() + packed


FORMATS: dict[str, Callable[[np.ndarray], bytes]] = {
    "ascii.ply": lambda rows: ply(rows, "ascii"),
    "little.ply": lambda rows: ply(rows, "binary_little_endian"),
    "big.ply": lambda rows: ply(rows, "binary_big_endian"),
    "ascii.pcd": lambda rows: pcd(rows, "ascii"),
    "binary.pcd": lambda rows: pcd(rows, "binary"),
    "compressed.pcd": lambda rows: pcd(rows, "binary_compressed"),
    "plain.xyz": text,
    "commas.xyz": lambda rows: b"# comment\n" + text(rows, ", "),
    "count.pts": lambda rows: f"{len(rows)}\n".encode() + text(rows),
    "plain.pwn": text,
}


def write(folder: Path, data: bytes, name: str) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_with_and_without_normals(tmp_path: Path, name: str) -> None:
    for rows in (POINTS, BOTH):
        path = write(tmp_path, FORMATS[name](rows), name)
        cloud = read_point_file(path)
        np.testing.assert_allclose(cloud.points, POINTS, atol=1e-6)
        assert (cloud.normals is None) == (rows is POINTS)
        if cloud.normals is not None:
            np.testing.assert_allclose(cloud.normals, NORMALS, atol=1e-6)
        sniffs = points.sniff(path), oriented_points.sniff(path)
        assert [sniff is not None for sniff in sniffs] == [rows is POINTS, rows is BOTH]
        path.rename(tmp_path / "unnamed")  # content, not suffix
        assert len(read_point_file(tmp_path / "unnamed").points) == 60


def test_old_pwn_has_normals_after_the_points(tmp_path: Path) -> None:
    path = write(tmp_path, b"60\n" + text(POINTS) + text(NORMALS), "old.pwn")
    cloud = read_point_file(path)
    assert cloud.normals is not None
    np.testing.assert_allclose(cloud.normals, NORMALS, atol=1e-6)


def test_colours_are_no_normals(tmp_path: Path) -> None:
    colours = RNG.integers(0, 256, (60, 3))
    rows = np.concatenate([POINTS, np.ones((60, 1)), colours], axis=1)
    assert read_point_file(write(tmp_path, b"60\n" + text(rows), "a.pts")).normals is None
    rows = np.concatenate([POINTS, colours / 255.0], axis=1)
    assert read_point_file(write(tmp_path, text(rows), "a.xyz")).normals is None
    rows = np.concatenate([POINTS, colours, NORMALS], axis=1)
    cloud = read_point_file(write(tmp_path, text(rows), "b.xyz"))
    assert cloud.normals is not None
    np.testing.assert_allclose(cloud.normals, NORMALS, atol=1e-6)


def test_splats_and_meshes_are_not_claimed(tmp_path: Path) -> None:
    splats = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + b"".join(
        b"property float %s\n" % name
        for name in (b"x", b"y", b"z", b"nx", b"ny", b"nz", b"f_dc_0", b"scale_0", b"rot_0")
    )
    mesh = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    mesh += b"element face 1\nproperty list uchar int vertex_indices\n"
    for data in (splats, mesh):
        path = write(tmp_path, data + b"end_header\n", "a.ply")
        assert points.sniff(path) is None and oriented_points.sniff(path) is None
    for data in (b"{}", b"", b"\0\1\2", b"solid x\n", b"1 2\n3 4\n"):
        assert look(write(tmp_path, data, "b.xyz")) is None


@pytest.mark.parametrize("name", FORMATS)
def test_files_cut_off_anywhere(tmp_path: Path, name: str) -> None:
    data = FORMATS[name](BOTH)
    for tenth in range(10):
        path = write(tmp_path, data[: len(data) * tenth // 10], name)
        points.sniff(path)
        try:
            cloud = read_point_file(path)
        except InputError as error:
            assert name in str(error) and len(str(error).splitlines()) == 1
        else:
            # Only text without a count can end between two rows and be whole; its last number may be short.
            assert "plain" in name or "commas" in name
            assert len(cloud.points) < 60


@pytest.mark.parametrize("count", ["-1", "2147483648", "999999999999999", "61", "1e3", "x"])
def test_counts_that_lie(tmp_path: Path, count: str) -> None:
    for name in ("ascii.ply", "little.ply", "ascii.pcd", "binary.pcd", "compressed.pcd", "count.pts"):
        data = FORMATS[name](POINTS)
        lied = data.replace(b"vertex 60", b"vertex " + count.encode()).replace(
            b"POINTS 60", b"POINTS " + count.encode()
        )
        if name == "count.pts":
            lied = count.encode() + lied[2:]
        assert lied != data
        path = write(tmp_path, lied, name)
        tracemalloc.start()
        with pytest.raises(InputError) as caught:
            read_point_file(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 5_000_000
        assert len(str(caught.value)) < 400


def test_headers_that_lie(tmp_path: Path) -> None:
    data = FORMATS["binary.pcd"](POINTS)
    for old, new, message in (
        (b"SIZE 4 4 4", b"SIZE 4 4 -4", "size -4"),
        (b"TYPE F F F", b"TYPE F F", "one entry for each field"),
        (b"COUNT 1 1 1", b"COUNT 1 1 99999999", "count 99999999"),
        (b"FIELDS x y z", b"FIELDS x y q", "no fields x, y and z"),
        (b"DATA binary", b"DATA zip", "DATA zip"),
        (b"DATA binary", b"NOTHING", "no DATA line"),
    ):
        with pytest.raises(InputError, match=message):
            read_point_file(write(tmp_path, data.replace(old, new), "a.pcd"))


def test_packed_points_that_unpack_too_far(tmp_path: Path) -> None:
    data = FORMATS["compressed.pcd"](POINTS)
    start = data.index(b"binary_compressed\n") + 18
    for packed, unpacked, message in (
        (740, 2**32 - 1, "cannot hold"),
        (2**32 - 1, 720, "packed"),
        (740, 10, "unpacked"),
        (33, 720, "not the 720"),
    ):
        lied = data[:start] + np.array([packed, unpacked], "<u4").tobytes() + data[start + 8 :]
        with pytest.raises(InputError, match=message):
            read_point_file(write(tmp_path, lied, "a.pcd"))


def test_lzf_unpacks_references() -> None:
    assert decompress(b"\x02abc" + bytes([(1 << 5), 2]), 6) == b"abcabc"
    assert decompress(b"\x00a" + bytes([7 << 5, 20, 0]), 30) == 30 * b"a"  # runs into what it writes
    for damaged in (b"\x05ab", b"\x20", bytes([1 << 5, 9]), b"\x00a" + bytes([7 << 5])):
        with pytest.raises(ValueError, match="packed points"):
            decompress(damaged, 30)


def test_numbers_that_are_none_are_left_out(tmp_path: Path) -> None:
    rows = BOTH.copy()
    rows[3, 0], rows[4, 1], rows[5, 3] = np.nan, np.inf, np.nan
    for name in FORMATS:
        cloud = read_point_file(write(tmp_path, FORMATS[name](rows), name))
        assert len(cloud.points) >= 57
        assert "2 points without finite coordinates left out" in cloud.notes
        assert np.isfinite(cloud.points).all() and cloud.normals is not None and np.isfinite(cloud.normals).all()


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(
    ("rows", "message"),
    [(np.ones((60, 3)), "1 distinct finite points"), (np.outer(np.arange(60.0), [1, -2, 3]), "on a line")],
    ids=["equal", "line"],
)
def test_points_that_are_equal_or_on_a_line(tmp_path: Path, name: str, rows: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_point_file(write(tmp_path, FORMATS[name](rows), name))


def test_clouds_that_are_no_surface(tmp_path: Path) -> None:
    for rows, message in (
        (np.full((60, 3), np.nan), "0 distinct finite points"),
        (np.concatenate([POINTS, np.zeros((60, 3))], axis=1), "normals are zero"),
    ):
        with pytest.raises(InputError, match=message):
            read_point_file(write(tmp_path, ply(rows, "ascii"), "a.ply"))
    for data, message in (
        (b"", "no points"),
        (b"1 2 3\n4 5\n", "row 2 has 2 numbers"),
        (b"1 2 3\n4 5 x\n", "text where"),
    ):
        with pytest.raises(InputError, match=message):
            read_point_file(write(tmp_path, data, "a.xyz"))
    with pytest.raises(InputError, match="is a directory"):
        read_point_file(tmp_path)
    with pytest.raises(InputError, match="No such file"):
        read_point_file(tmp_path / "none.xyz")
    with pytest.raises(InputError, match="not a file of points"):
        read_point_file(write(tmp_path, b"\0\1", "a.bin"))


@pytest.mark.parametrize("seed", range(3))
def test_noise(tmp_path: Path, seed: int) -> None:
    for suffix in (".ply", ".pcd", ".xyz", ".pts", ".pwn"):
        path = write(tmp_path, np.random.default_rng(seed).bytes(1000), f"noise{suffix}")
        points.sniff(path)
        with pytest.raises(InputError, match="noise"):
            read_point_file(path)


MODULES = [soup, oriented_points, points]


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_entry_modules_keep_the_contract(module) -> None:
    code = f"import sys, {module.__name__} as m; m.ndf_representation()\n"
    code += "print([x for x in ('numpy', 'torch', 'scipy') if x in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
    spec: RepresentationSpec = module.ndf_representation()
    assert spec.api_version == 1
    assert spec.config.model_config["frozen"] and spec.config.model_config["extra"] == "forbid"
    assert all(field.description for field in spec.config.model_fields.values())
    weights = {"soup": 1e4, "oriented-points": 1e4, "points": 1e4}
    assert spec.training_defaults["loss"] == {"cycle": weights[spec.name], "projection": 1e4}
    assert spec.support == ("partial" if spec.name == "points" else "full")


def test_every_shared_file_is_read_as_what_it_is(shared_data: Path) -> None:
    counts = {"gpmr_hand.pwn": 52_398, "stanford_bun000.ply": 40_256, "o3d_bunnyData.pts": 30_571}
    oriented = {"gpmr_hand.pwn", "pcu_duplicated_pcloud.ply"}
    for path in (shared_data / "pointcloud").iterdir():
        content = look(path)
        assert content is not None
        assert content.normals == (path.name in oriented), path.name
        if path.name in counts:
            assert len(read_point_file(path).points) == counts[path.name]
