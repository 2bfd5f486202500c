"""Volumes: every format in its frame, the iso value, borders, small parts, accuracy; real ones; what is refused."""

from __future__ import annotations

import gzip
import struct
import zipfile
from pathlib import Path
from typing import Any

import mrcfile
import nibabel
import numpy as np
import pytest
import torch
from ndf_plugin_sdf.grid import GridConfig, sniff
from ndf_plugin_sdf.grid_surface import _field, open_grid  # pyright: ignore[reportPrivateUsage]
from ndf_plugin_sdf.volumes.parts import clear_of_zero, without_small_parts
from ndf_plugin_sdf.volumes.read import framed, read_volume
from scipy.spatial import KDTree

import ndf_core
from ndf_core.base_mesh.checks import check_base_mesh
from ndf_core.errors import InputError
from ndf_core.surfaces.random_lines import sample_level_set

SHAPE = (24, 20, 22)
AFFINE = np.array([[0.0, 0.4, 0, 3], [0.5, 0, 0, -2], [0, 0.1, 0.6, 1], [0, 0, 0, 1]])
"""Turned axes, uneven spacing and a shear."""
CENTRE = AFFINE[:3, :3] @ ((np.array(SHAPE) - 1) / 2) + AFFINE[:3, 3]


def ball(affine: np.ndarray = AFFINE, radius: float = 2.5) -> np.ndarray:
    """Signed distances of a ball about the middle of the volume."""
    index = np.argwhere(np.ones(SHAPE))
    points = index @ affine[:3, :3].T + affine[:3, 3]
    return (np.linalg.norm(points - CENTRE, axis=1) - radius).reshape(SHAPE).astype(np.float32)


def write(path: Path, values: np.ndarray, affine: np.ndarray = AFFINE) -> Path:
    if path.suffix == ".npz":
        np.savez_compressed(path, volume=values, affine=affine)
    elif path.suffix == ".npy":
        np.save(path, np.asfortranarray(values))
    elif path.suffix in (".nii", ".gz"):
        nibabel.save(nibabel.Nifti1Image(values, affine), path)  # pyright: ignore
    else:
        with mrcfile.new(path) as file:
            file.set_data(np.ascontiguousarray(values.transpose(2, 1, 0)))
            file.voxel_size = tuple(np.diag(affine)[:3])
            file.header.origin = tuple(affine[:3, 3])
    return path


@pytest.mark.parametrize("name", ["ball.npz", "ball.nii", "ball.nii.gz"])
def test_frames_of_headers_are_kept(tmp_path: Path, name: str) -> None:
    surface = open_grid(write(tmp_path / name, ball()), GridConfig())
    assert any("grow evenly" in note for note in surface.notes)
    points, normals = surface.sample(2000, np.random.default_rng(0))  # pyright: ignore
    np.testing.assert_allclose(np.linalg.norm(points - CENTRE, axis=1), 2.5, atol=5e-3)
    assert ((points - CENTRE) / 2.5 * normals).sum(axis=1).min() > 0.99
    base = surface.base_mesh.extract(500)
    assert check_base_mesh(base).genus == 0
    np.testing.assert_allclose(np.linalg.norm(base.vertices - CENTRE, axis=1), 2.5, atol=0.1)


def test_mrc_axes_origin_and_start_as_mrcfile_reads_them(tmp_path: Path) -> None:
    affine = np.diag([0.4, 0.5, 0.6, 1.0])
    affine[:3, 3] = 3, -2, 1
    values = np.random.default_rng(0).normal(size=SHAPE).astype(np.float32)
    volume = read_volume(write(tmp_path / "a.mrc", values, affine), GridConfig())
    np.testing.assert_array_equal(volume.values, values)
    np.testing.assert_allclose(volume.matrix, affine[:3, :3], rtol=1e-6)
    np.testing.assert_allclose(volume.origin, [3, -2, 1])
    with mrcfile.open(tmp_path / "a.mrc", "r+") as file:
        file.header.origin = (0, 0, 0)
        file.header.nxstart, file.header.nystart, file.header.nzstart = 5, 6, 7
        file.header.mapc, file.header.mapr, file.header.maps = 2, 1, 3
    volume = read_volume(tmp_path / "a.mrc", GridConfig())
    np.testing.assert_array_equal(volume.values, values.transpose(1, 0, 2))
    np.testing.assert_allclose(volume.origin, np.array([6, 5, 7]) * [0.4, 0.5, 0.6], rtol=1e-6)


@pytest.mark.parametrize("dtype", ["int16", "uint8"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_nifti_integers_with_a_slope_in_either_byte_order(tmp_path: Path, dtype: str, order: Any) -> None:
    values = np.random.default_rng(0).integers(0, 200, SHAPE).astype(dtype)
    image = nibabel.Nifti1Image(values, AFFINE, nibabel.Nifti1Header(endianness=order))
    image.header.set_data_dtype(np.dtype(dtype).newbyteorder(order))
    image.header.set_slope_inter(0.5, 10)
    image.to_filename(tmp_path / "a.nii")
    expected = np.asarray(nibabel.load(tmp_path / "a.nii").dataobj)  # pyright: ignore
    volume = read_volume(tmp_path / "a.nii", GridConfig())
    np.testing.assert_allclose(volume.values, expected, rtol=1e-6)
    np.testing.assert_allclose(volume.matrix, AFFINE[:3, :3], atol=1e-6)


def test_options_set_the_frame_of_bare_arrays(tmp_path: Path) -> None:
    path = write(tmp_path / "a.npy", ball())
    volume = read_volume(path, GridConfig(spacing=(1, 2, 3), origin=(4, 5, 6)))
    np.testing.assert_array_equal(volume.matrix, np.diag([1.0, 2, 3]))
    np.testing.assert_array_equal(volume.origin, [4, 5, 6])
    assert open_grid(ball(), GridConfig()).fingerprint != open_grid(ball(), GridConfig(iso=0.1)).fingerprint


def test_otsu_and_the_side(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    image = np.where(ball() < 0, 900.0, 100.0) + rng.normal(size=SHAPE) * 20
    notes = open_grid(image, GridConfig()).notes
    threshold = float(next(note for note in notes if "Otsu" in note).split()[2].rstrip(","))
    assert 300 < threshold < 700
    assert any("inside is above" in note for note in notes)
    with pytest.raises(InputError, match="no level set at 5000"):
        open_grid(image, GridConfig(iso=5000))
    with pytest.raises(InputError, match="all voxels are 3"):
        open_grid(np.full(SHAPE, 3.0), GridConfig())


def test_the_border_closes_what_it_cuts() -> None:
    cut = ball()[:, :, :13]
    surface = open_grid(cut, GridConfig(resolution=64))
    assert any("border at +k" in note for note in surface.notes)
    base = surface.base_mesh.extract(400)
    assert check_base_mesh(base).genus == 0
    assert abs(base.vertices[:, 2].max() - 12) < 0.2
    answer = surface.projector.project(torch.tensor([[11.0, 10.0, 12.1], [12.0, 9.0, 11.8]], dtype=torch.float64))
    assert bool(answer.converged.all())
    np.testing.assert_allclose(answer.points[:, 2], 12.0, atol=1e-6)


def test_small_bodies_and_cavities_go_and_the_rest_stays() -> None:
    phi = ball().copy()
    phi[2:4, 2:4, 2:4] = -1.0  # a crumb
    phi[12, 10, 11] = 2.0  # a hole in the middle
    cleaned, notes = without_small_parts(phi, 0.05)
    assert len(notes) == 2
    np.testing.assert_array_equal(cleaned < 0, ball() < 0)
    untouched = phi == ball()
    np.testing.assert_array_equal(cleaned[untouched], phi[untouched])
    assert without_small_parts(phi, 0.0)[0] is phi


def test_splines_have_no_islands_that_no_voxel_shows() -> None:
    """Beside two voxels close to zero, amid larger ones, the spline would swing across it."""
    phi = np.where(ball() < 0, -10.0, 10.0).astype(np.float32)
    phi[12, 10, 10:12] = -0.01
    surface = open_grid(phi, GridConfig(iso=0.0, inside="below", smallest_part=0.0))
    points, _ = surface.sample(4000, np.random.default_rng(0))  # pyright: ignore
    assert np.linalg.norm(points - [12, 10, 10.5], axis=1).min() > 2
    cleared = clear_of_zero(phi)
    np.testing.assert_array_equal(cleared < 0, phi < 0)
    assert (cleared == phi).sum() == phi.size - 2


@pytest.mark.parametrize("cut", [False, True])
def test_no_surface_lies_within_the_clearance(cut: bool) -> None:
    """And far from the surface it is a good part of the distance, though the field says little there."""
    values = np.clip(ball(), -0.3, 0.3)[:, : 10 if cut else None]
    volume = framed(np.ascontiguousarray(values), AFFINE, (), GridConfig(), "the array")
    field = _field(volume, GridConfig())[0]
    points, _ = sample_level_set(field, 20_000, np.random.default_rng(0))
    places = volume.positions(np.random.default_rng(1).uniform(-2, np.array(values.shape) + 1, (3000, 3)))
    queries = torch.from_numpy(places)
    clearance = field.clearance(queries, field.values(queries)).numpy()
    distance = KDTree(points).query(places)[0]
    assert (clearance <= distance + 1e-3).all()
    free = field.field.clearance(queries, torch.zeros(len(queries))).numpy()
    far = distance > 2.5
    assert far.any() and (free[far] > 0.15 * distance[far]).mean() > 0.9


def test_splines_are_more_accurate_than_linear_interpolation() -> None:
    """On a torus sampled with five voxels across its tube; each interpolant's samples against the true surface."""
    index = np.argwhere(np.ones((40, 40, 16))) - np.array([19.5, 19.5, 7.5])
    field = np.hypot(np.hypot(index[:, 0], index[:, 1]) - 12, index[:, 2]) - 2.6
    errors = {}
    for kind in ("linear", "catmull_rom", "b_spline"):
        surface = open_grid(field.reshape(40, 40, 16), GridConfig(iso=0.0, interpolation=kind))
        points = surface.sample(1500, np.random.default_rng(0))[0] - [19.5, 19.5, 7.5]  # pyright: ignore
        errors[kind] = np.abs(np.hypot(np.hypot(points[:, 0], points[:, 1]) - 12, points[:, 2]) - 2.6).mean()
    assert errors["b_spline"] < 0.8 * errors["catmull_rom"] < 0.8 * errors["linear"]


def test_voxels_that_are_no_numbers() -> None:
    values = ball()
    values[0, 0, 0] = np.nan
    values[1, 1, 1] = np.inf
    assert any("2 voxels are not finite" in note for note in open_grid(-values, GridConfig(iso=0)).notes)
    with pytest.raises(InputError, match="no voxel is a finite number"):
        open_grid(np.full(SHAPE, np.nan), GridConfig())


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.nii", "a.nii.gz", "a.mrc"])
def test_files_cut_off_anywhere_are_one_error(tmp_path: Path, name: str) -> None:
    data = write(tmp_path / name, ball(), np.diag([1.0, 1, 1, 1])).read_bytes()
    path = tmp_path / f"cut-{name}"
    for tenth in range(10):
        path.write_bytes(data[: len(data) * tenth // 10])
        sniff(path)
        with pytest.raises(InputError, match="cut-a"):
            open_grid(path, GridConfig())


def test_headers_that_lie(tmp_path: Path) -> None:
    raw = bytearray(write(tmp_path / "a.nii", ball()).read_bytes())
    cases = {
        "sides": (40, struct.pack("<8h", 3, 32767, 32767, 32767, 1, 1, 1, 1), "more than the|cut off"),
        "negative": (40, struct.pack("<8h", 3, -5, 20, 22, 1, 1, 1, 1), "its dimensions are"),
        "series": (40, struct.pack("<8h", 4, 24, 20, 22, 9, 1, 1, 1), "a series"),
        "complex": (70, struct.pack("<2h", 32, 64), "not real numbers"),
        "offset": (108, struct.pack("<f", 1e12), "begin at byte"),
        "nan": (108, struct.pack("<f", float("nan")), "begin at byte"),
    }
    for name, (place, bytes_there, words) in cases.items():
        lie = bytearray(raw)
        lie[place : place + len(bytes_there)] = bytes_there
        for suffix, data in ((".nii", bytes(lie)), (".nii.gz", gzip.compress(bytes(lie)))):
            (tmp_path / (name + suffix)).write_bytes(data)
            with pytest.raises(InputError, match=words if suffix == ".nii" else "."):
                open_grid(tmp_path / (name + suffix), GridConfig())
    mrc = bytearray(write(tmp_path / "a.mrc", ball(), np.eye(4)).read_bytes())
    for place, number, words in (
        (0, 1 << 19, "cut off"),
        (0, -4, "its sides"),
        (12, 4, "complex"),
        (92, -1, "extended"),
    ):
        lie = bytearray(mrc)
        lie[place : place + 4] = struct.pack("<i", number)
        (tmp_path / "lie.mrc").write_bytes(lie)
        with pytest.raises(InputError, match=words):
            open_grid(tmp_path / "lie.mrc", GridConfig())


@pytest.mark.parametrize("name", ["lie.npy", "lie.npz"])
@pytest.mark.parametrize("shape", [(-6, 5, 5), (2**31, 5, 5), (100_000, 100_000, 4), (2**62, 2**62, 4), (12, 12, 12)])
def test_arrays_that_claim_more_than_they_hold(tmp_path: Path, name: str, shape: tuple[int, ...]) -> None:
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".encode()
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + bytes(4 * 12 * 12 * 11)
    path = tmp_path / name
    path.write_bytes(array)
    if path.suffix == ".npz":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("values.npy", array)
    sniff(path)
    with pytest.raises(InputError, match=name):
        open_grid(path, GridConfig())


def test_sniffing_tells_volumes_from_other_arrays(tmp_path: Path) -> None:
    np.savez(tmp_path / "net.npz", **{"0.weight": np.zeros((8, 3)), "2.weight": np.zeros((1, 8))})  # pyright: ignore
    np.save(tmp_path / "points.npy", np.zeros((50, 3)))
    found = {
        name: getattr(sniff(write(tmp_path / name, ball(), np.eye(4))), "confidence", None)
        for name in ("a.npy", "a.npz", "a.nii", "a.nii.gz", "a.mrc")
    }
    assert found == {"a.npy": 0.6, "a.npz": 0.6, "a.nii": 1.0, "a.nii.gz": 1.0, "a.mrc": 1.0}
    assert sniff(tmp_path / "net.npz") is None
    assert (sniff(tmp_path / "points.npy") or pytest.fail("not seen")).confidence == 0.3


@pytest.mark.parametrize(("name", "iso", "sides"), [("EMD-3197.map", None, True), ("CT_pitch.nii.gz", 150, True)])
def test_real_volumes(shared_data: Path, name: str, iso: float | None, sides: bool) -> None:
    surface = ndf_core.open(shared_data / "grid" / name, iso=iso, resolution=64)
    assert surface.representation == "grid"
    assert any("closed there, flat" in note for note in surface.notes) == sides
    points, _ = surface.sample(2000, np.random.default_rng(0))  # pyright: ignore
    size = float(np.ptp(points, axis=0).max())
    noise = np.random.default_rng(1).normal(size=points.shape) * 0.003 * size
    answer = surface.projector.project(torch.from_numpy(points + noise))
    assert float(answer.converged.double().mean()) > 0.999
    moved = (answer.points - torch.from_numpy(points + noise)).norm(dim=1)
    assert float(((moved - torch.from_numpy(np.linalg.norm(noise, axis=1))) / size).quantile(0.95)) < 2e-4
