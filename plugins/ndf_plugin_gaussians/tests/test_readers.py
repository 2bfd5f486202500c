"""Each format against an encoder of its own, and real files of one object in several formats against each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ndf_plugin_gaussians.readers.splat_file import read_splat_file
from ndf_plugin_gaussians.splats import Splats
from scipy.spatial import cKDTree
from splat_writers import compressed, inria, random_splats, sog_files, splat, spz, write_folder, zipped

COUNT = 600
WRITTEN = random_splats(COUNT)
# Largest errors of centres, log scales, covariances (of their norm), opacities and colours: half of a step of the
# format, or a bit more. Scales of .spz have steps of 1/16, those of SOG 2 of the range / 255.
EXACT = (1e-6, 1e-5, 1e-4, 1e-6, 1e-6)
CASES = {
    "inria": ("a.ply", lambda: inria(WRITTEN), EXACT),
    "inria degree 3": ("a.ply", lambda: inria(WRITTEN, degree=3, stretch=1.26), EXACT),
    "compressed 12": ("a.ply", lambda: compressed(WRITTEN, False), (2e-3, 3e-3, 0.03, 0.002, 0.002)),
    "compressed 18": ("a.ply", lambda: compressed(WRITTEN, True), (2e-3, 3e-3, 0.03, 0.002, 0.002)),
    "splat": ("a.splat", lambda: splat(WRITTEN), (1e-6, 1e-5, 0.06, 0.002, 0.002)),
    "spz 1": ("a.spz", lambda: spz(WRITTEN, 1), (1e-3, 0.032, 0.25, 0.002, 0.004)),
    "spz 2": ("a.spz", lambda: spz(WRITTEN, 2), (2e-4, 0.032, 0.25, 0.002, 0.004)),
    "spz 3": ("a.spz", lambda: spz(WRITTEN, 3), (2e-4, 0.032, 0.1, 0.002, 0.004)),
    "spz 4": ("a.spz", lambda: spz(WRITTEN, 4), (2e-4, 0.032, 0.1, 0.002, 0.004)),
    "spz 4 degree 3": ("a.spz", lambda: spz(WRITTEN, 4, degree=3), (2e-4, 0.032, 0.1, 0.002, 0.004)),
    "sog 1": ("a.sog", lambda: zipped(sog_files(WRITTEN, 1)), (5e-5, 0.02, 0.08, 0.006, 0.003)),
    "sog 2": ("a.sog", lambda: zipped(sog_files(WRITTEN, 2)), (5e-5, 0.02, 0.08, 0.002, 0.003)),
}


def covariances(splats: Splats) -> np.ndarray:
    frames = splats.frames()
    return np.einsum("nij,nj,nkj->nik", frames, splats.scales**2, frames)


def expected() -> Splats:
    return Splats(**WRITTEN)


@pytest.mark.parametrize("case", CASES)
def test_what_was_written_is_read(case: str, tmp_path: Path) -> None:
    name, write, tolerance = CASES[case]
    (tmp_path / name).write_bytes(write())
    found, notes = read_splat_file(tmp_path / name)
    wanted = expected()
    assert f"{COUNT} splats" in notes[0]
    wanted_covariance, found_covariance = covariances(wanted), covariances(found)
    error = np.linalg.norm(found_covariance - wanted_covariance, axis=(1, 2))
    errors = (
        np.abs(found.centres - wanted.centres).max(),
        np.abs(np.log(found.scales) - np.log(wanted.scales)).max(),
        (error / np.linalg.norm(wanted_covariance, axis=(1, 2))).max(),
        np.abs(found.opacities - wanted.opacities).max(),
        np.abs(found.colours - wanted.colours).max(),
    )
    assert all(error <= most for error, most in zip(errors, tolerance, strict=True)), errors
    np.testing.assert_allclose(np.linalg.norm(found.rotations, axis=1), 1.0, atol=1e-12)


def test_frames_are_rotations_about_the_axis_of_the_quaternion() -> None:
    angle = 0.7
    turn = np.array([[np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]])
    one = Splats(np.zeros((1, 3)), np.ones((1, 3)), turn, np.ones(1), np.ones((1, 3)))
    c, s = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose(one.frames()[0], [[c, -s, 0], [s, c, 0], [0, 0, 1]], atol=1e-15)


def test_a_folder_and_an_archive_with_a_folder_are_read_alike(tmp_path: Path) -> None:
    files = sog_files(WRITTEN)
    folder = write_folder(files, tmp_path / "set")
    (tmp_path / "nested.sog").write_bytes(zipped({f"scene/{name}": content for name, content in files.items()}))
    (tmp_path / "flat.sog").write_bytes(zipped(files))
    flat = read_splat_file(tmp_path / "flat.sog")[0]
    for path in (folder, tmp_path / "nested.sog"):
        np.testing.assert_array_equal(read_splat_file(path)[0].centres, flat.centres)


def test_the_content_decides_not_the_suffix(tmp_path: Path) -> None:
    (tmp_path / "a.sog").write_bytes(inria(WRITTEN))
    (tmp_path / "b.ply").write_bytes(spz(WRITTEN, 4))
    (tmp_path / "c.bin").write_bytes(zipped(sog_files(WRITTEN)))
    for name, kind in (("a.sog", "3DGS .ply"), ("b.ply", ".spz"), ("c.bin", ".sog")):
        assert kind in read_splat_file(tmp_path / name)[1][0]


def test_the_last_chunk_may_be_shorter(tmp_path: Path) -> None:
    few = {key: values[:257] for key, values in WRITTEN.items()}
    (tmp_path / "a.ply").write_bytes(compressed(few, True))
    found = read_splat_file(tmp_path / "a.ply")[0]
    np.testing.assert_allclose(found.centres, few["centres"], atol=2e-3)


def matched(one: Splats, other: Splats, turn: tuple[int, int, int]) -> dict[str, float]:
    """Medians of the differences between splats and their nearest in the other file, after a half turn."""
    signs = np.array(turn, dtype=float)
    distance, index = cKDTree(other.centres).query(one.centres * signs)
    turned = covariances(one) * np.outer(signs, signs)
    size = np.linalg.norm(turned, axis=(1, 2))
    return {
        "centre": float(np.median(distance)),
        "opacity": float(np.median(np.abs(one.opacities - other.opacities[index]))),
        "colour": float(np.median(np.abs(one.colours - other.colours[index]))),
        "covariance": float(np.median(np.linalg.norm(turned - covariances(other)[index], axis=(1, 2)) / size)),
    }


@pytest.mark.parametrize(
    ("one", "other", "turn", "most"),
    [
        ("statue_angel.sog", "statue_angel.inria.ply", (1, 1, 1), 1e-6),
        # Their editors wrote them in other axes: half a turn about z, and (.spz has y up) about x.
        ("statue_angel.sog", "angel.compressed.ply", (-1, -1, 1), 0.05),
        ("biker.spz", "biker.compressed.ply", (1, -1, -1), 0.05),
    ],
)
def test_real_files_of_one_object_agree(
    splat_data: Path, one: str, other: str, turn: tuple[int, int, int], most: float
) -> None:
    difference = matched(read_splat_file(splat_data / one)[0], read_splat_file(splat_data / other)[0], turn)
    assert difference["covariance"] <= most
    assert difference["centre"] <= 2e-4
    assert difference["opacity"] <= 1e-6
    assert difference["colour"] <= 0.002


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("statue_angel.sog", 71_359),
        ("angel.compressed.ply", 71_377),
        ("biker.spz", 152_746),
        ("donut_fused.ply", 45_624),
        ("gs3d_lod2_tile0.ply", 6_831),
        ("playbot_lod4.sog_dir", 8_406),
        ("statue_st-peter.sog", 133_618),
    ],
)
def test_real_files_are_read_whole(splat_data: Path, name: str, count: int) -> None:
    found, notes = read_splat_file(splat_data / name)
    assert len(found) == count
    assert len(notes) == 1
    assert found.opacities.min() >= 0
    assert found.opacities.max() <= 1
