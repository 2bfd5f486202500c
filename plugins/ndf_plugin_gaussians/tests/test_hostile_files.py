"""Files that lie, are cut off or blow up: one clear error or a working result, within bounded memory."""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from ndf_plugin_gaussians.readers.limits import MOST_SPLATS
from ndf_plugin_gaussians.readers.splat_file import read_splat_file
from splat_writers import compressed, inria, picture, random_splats, sog_files, splat, spz, write_folder, zipped

from ndf_core.errors import InputError

SPLATS = random_splats(300)
WRITERS: dict[str, tuple[str, Callable[[], bytes]]] = {
    "inria": ("a.ply", lambda: inria(SPLATS, degree=1)),
    "compressed": ("a.ply", lambda: compressed(SPLATS, True)),
    "splat": ("a.splat", lambda: splat(SPLATS)),
    "spz 2": ("a.spz", lambda: spz(SPLATS, 2)),
    "spz 4": ("a.spz", lambda: spz(SPLATS, 4, degree=1)),
    "sog": ("a.sog", lambda: zipped(sog_files(SPLATS))),
}
MOST_MEMORY = 64 << 20


def read(path: Path, content: bytes) -> int:
    """Splats read, after checking that little memory was needed."""
    path.write_bytes(content)
    tracemalloc.start()
    try:
        return len(read_splat_file(path)[0])
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < MOST_MEMORY, f"{peak / 1e6:.0f} MB"


def check_refused(path: Path, content: bytes, match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        read(path, content)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("case", WRITERS)
def test_files_cut_off_anywhere_are_refused(case: str, tmp_path: Path) -> None:
    name, write = WRITERS[case]
    whole = write()
    for tenth in range(1, 10):
        part = whole[: len(whole) * tenth // 10]
        if case == "splat" and len(part) % 32 == 0:
            assert read(tmp_path / name, part) == len(part) // 32  # there is no header that could tell
        else:
            check_refused(tmp_path / name, part, "cannot be read|no file of")
    check_refused(tmp_path / name, whole[:-1], "cannot be read|no file of")


@pytest.mark.parametrize("case", WRITERS)
def test_damaged_bytes_never_crash(case: str, tmp_path: Path) -> None:
    name, write = WRITERS[case]
    whole = bytearray(write())
    rng = np.random.default_rng(1)
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), 3):
            damaged[place] = rng.integers(256)
        with contextlib.suppress(InputError):
            assert read(tmp_path / name, bytes(damaged)) <= 300


@pytest.mark.parametrize("count", ["-5", "2147483648", "301", "999999999999999", "1e3", "x"])
@pytest.mark.parametrize("case", ["inria", "compressed"])
def test_ply_headers_that_count_wrong_are_refused(case: str, count: str, tmp_path: Path) -> None:
    whole = WRITERS[case][1]()
    check_refused(
        tmp_path / "a.ply", whole.replace(b"vertex 300", b"vertex " + count.encode()), "cannot be read|no file of"
    )


def test_chunks_that_do_not_fit_the_splats_are_refused(tmp_path: Path) -> None:
    whole = WRITERS["compressed"][1]()
    check_refused(tmp_path / "a.ply", whole.replace(b"chunk 2", b"chunk 1"), "chunks of 256")


@pytest.mark.parametrize("count", [0, 1 << 31, 0xFFFFFFFF, 301, MOST_SPLATS])
@pytest.mark.parametrize("version", [2, 4])
def test_spz_headers_that_count_wrong_are_refused(version: int, count: int, tmp_path: Path) -> None:
    whole = spz(SPLATS, version)
    raw = gzip.decompress(whole) if version == 2 else whole
    lying = raw[:8] + struct.pack("<I", count) + raw[12:]
    check_refused(tmp_path / "a.spz", gzip.compress(lying) if version == 2 else lying, "announces|need|holds")


@pytest.mark.parametrize("version", [0, 5, 255])
def test_unknown_versions_of_spz_are_named(version: int, tmp_path: Path) -> None:
    raw = spz(SPLATS, 4)
    check_refused(tmp_path / "a.spz", raw[:4] + struct.pack("<I", version) + raw[8:], f"version {version}")


def test_a_gzip_bomb_is_unpacked_no_further_than_the_header_says(tmp_path: Path) -> None:
    raw = gzip.decompress(spz(SPLATS, 3))
    check_refused(tmp_path / "a.spz", gzip.compress(raw + bytes(200 << 20), 1), "goes on after its splats")


def test_a_zstd_bomb_is_unpacked_no_further_than_the_header_says(tmp_path: Path) -> None:
    bomb = zstandard.ZstdCompressor().compress(bytes(200 << 20))
    raw = spz(SPLATS, 4)
    lying = raw[:32] + struct.pack("<QQ", len(bomb), 300 * 9) + raw[48 : 32 + 16 * 5] + bomb
    check_refused(tmp_path / "a.spz", lying, "announces|holds|damaged")


def test_pictures_that_blow_up_are_not_decoded(tmp_path: Path) -> None:
    files = sog_files(SPLATS)
    files["quats.webp"] = picture(np.zeros((4096 * 4096, 4), np.uint8), 4096)
    path = tmp_path / "a.sog"
    check_refused(path, zipped(files), "16,777,216 pixels for 300 splats")


def test_zip_bombs_are_not_unpacked(tmp_path: Path) -> None:
    for name in ("means_l.webp", "meta.json"):
        files = sog_files(SPLATS) | {name: bytes(300 << 20)}
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for key, content in files.items():
                archive.writestr(key, content)
        check_refused(tmp_path / "a.sog", out.getvalue(), f"{name} unpacks to more than")


@pytest.mark.parametrize("name", ["../secret.webp", "/etc/passwd", "a\\b.webp", "", ".."])
def test_names_that_lead_out_of_the_folder_are_refused(name: str, tmp_path: Path) -> None:
    files = sog_files(SPLATS)
    meta = json.loads(files["meta.json"])
    meta["quats"]["files"] = [name]
    (tmp_path / "secret.webp").write_bytes(files["quats.webp"])
    folder = write_folder(files | {"meta.json": json.dumps(meta).encode()}, tmp_path / "set")
    with pytest.raises(InputError, match="no plain file name"):
        read_splat_file(folder)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"count": 10**12}, "announces"),
        ({"count": -1}, "announces"),
        ({"count": "many"}, "cannot be read"),
        ({"count": None}, "how many splats"),
        ({"version": 3}, "version 3"),
        ({"means": {"files": ["means_l.webp", "means_u.webp"], "mins": [0, 0], "maxs": [1, 1, 1]}}, "means.mins"),
        ({"scales": {"files": ["scales.webp"], "codebook": ["a"] * 256}}, "scales.codebook"),
        ({"sh0": {"files": ["sh0.webp"], "codebook": [0.0]}}, "sh0.codebook"),
        ({"quats": {}}, "names no file"),
        ({"quats": {"files": ["absent.webp"]}}, "there is no absent.webp"),
    ],
)
def test_descriptions_that_are_wrong_are_refused(change: dict[str, object], match: str, tmp_path: Path) -> None:
    files = sog_files(SPLATS)
    meta = json.loads(files["meta.json"]) | change
    check_refused(tmp_path / "a.sog", zipped(files | {"meta.json": json.dumps(meta).encode()}), match)


def test_a_list_as_description_is_refused(tmp_path: Path) -> None:
    check_refused(tmp_path / "a.sog", zipped(sog_files(SPLATS) | {"meta.json": b"[1]"}), "how many splats")
    check_refused(tmp_path / "a.sog", zipped(sog_files(SPLATS) | {"meta.json": b"["}), "is no JSON")


def test_files_of_another_kind_are_refused(tmp_path: Path) -> None:
    check_refused(tmp_path / "a.ply", b"PNG not at all", "no file of Gaussian splats")
    check_refused(tmp_path / "a.spz", b"PNG not at all", "cannot be read as .spz")
    check_refused(tmp_path / "a.sog", b"PNG not at all", "cannot be read as .sog")
    check_refused(tmp_path / "a.splat", b"x" * 33, "no whole number of rows")


def test_numbers_that_are_not_finite_are_left_out_and_counted(tmp_path: Path) -> None:
    bad = {key: values.copy() for key, values in SPLATS.items()}
    bad["centres"][:7, 1] = np.nan
    bad["centres"][7:10, 0] = np.inf
    bad["scales"][10:12, 2] = np.inf
    (tmp_path / "a.ply").write_bytes(inria(bad))
    found, notes = read_splat_file(tmp_path / "a.ply")
    assert len(found) == 288
    assert "12 splats with numbers that are not finite were left out" in notes[1]
    bad["centres"][:] = np.nan
    check_refused(tmp_path / "a.ply", inria(bad), "none of its 300 splats has finite numbers")
