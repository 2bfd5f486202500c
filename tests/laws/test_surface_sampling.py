"""Samples of the mapped surface: even by area, apart from each other, and where the map says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.stats import chisquare
from small_assets import icosphere, small_content, torus

from ndf_core.asset.asset import Asset
from ndf_core.asset.dense_map import dense_map
from ndf_core.asset.pushforward import mapped_points
from ndf_core.errors import ConfigError
from ndf_core.mesh import face_normals
from ndf_core.processing.surface_sampling import blue_noise, radius_for, white_noise

ROUGH = Asset(small_content(icosphere(1), amplitude=0.6, center=(5.0, 0.0, -3.0), scale=2.0))
SMOOTH = Asset(small_content(torus(24, 12), amplitude=0.0))


def test_the_pushforward_is_the_evaluators_and_its_finite_differences() -> None:
    rng = np.random.default_rng(0)
    faces = rng.integers(0, len(ROUGH.content.faces), 300).astype(np.int32)
    inside = rng.dirichlet((5, 5, 5), 300)
    found = mapped_points(ROUGH.content, faces, inside)
    assert np.abs(found.points - ROUGH.evaluate(faces, inside)).max() < 1e-5
    step = 1e-6
    columns = []
    for corner in (1, 2):
        shift = np.zeros(3)
        shift[[0, corner]] = -step, step
        ahead, behind = (mapped_points(ROUGH.content, faces, inside + sign * shift).points for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    area = np.cross(*columns)
    triangles = ROUGH.content.vertices[ROUGH.content.faces[faces]]
    base = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    ratio = np.linalg.norm(area, axis=1) / np.linalg.norm(base, axis=1)
    # A ReLU may switch between the two points: a few rows may differ.
    assert np.quantile(np.abs(found.area_ratio - ratio), 0.97) < 1e-5
    assert np.quantile(1 - (found.normals * area).sum(1) / np.linalg.norm(area, axis=1), 0.97) < 1e-8


def test_white_noise_is_even_by_mapped_area() -> None:
    """Counts in the base faces against their areas on the mapped surface, by chi-square."""
    count = 40_000
    found = white_noise(ROUGH, count, seed=3)
    content = ROUGH.content
    dense = dense_map(len(content.faces), ROUGH.evaluate, len(content.faces) * 900)
    areas = np.linalg.norm(face_normals(dense.vertices, dense.triangles), axis=1).reshape(len(content.faces), -1)
    expected = areas.sum(axis=1) / areas.sum() * count
    assert expected.max() > 3 * expected.min(), "or it would say little"
    counts = np.bincount(found.base_faces, minlength=len(content.faces))
    assert chisquare(counts, expected).pvalue > 0.01
    uniform = np.linalg.norm(face_normals(content.vertices, content.faces), axis=1)
    assert chisquare(counts, uniform / uniform.sum() * count).pvalue < 1e-6, "not by the base mesh's area"


def test_samples_are_where_the_map_takes_their_base_points() -> None:
    found = blue_noise(ROUGH, 0.5)
    points = ROUGH.map_points(found.base_faces, found.barycentric)
    assert np.abs(points - found.points).max() < 1e-4
    assert np.linalg.norm(found.normals, axis=1) == pytest.approx(1)


@pytest.mark.parametrize("asset", [ROUGH, SMOOTH])
def test_blue_noise_keeps_its_distance_and_leaves_no_room(asset: Asset) -> None:
    radius = radius_for(asset, 1500)
    found = blue_noise(asset, radius, seed=1)
    assert KDTree(found.points).query(found.points, k=2)[0][:, 1].min() >= radius
    assert len(found.points) == pytest.approx(1500, rel=0.05 if asset is SMOOTH else 0.2)
    gaps = KDTree(found.points).query(white_noise(asset, 20_000, seed=2).points)[0]
    assert (gaps > radius).mean() < 0.01


def spectrum(points: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean power by wave number of the points of a flat periodic square."""
    size = 24
    waves = np.array([(i, j) for i in range(-size, size + 1) for j in range(size + 1) if i or j])
    power = np.abs(np.exp(-2j * np.pi * points / side @ waves.T).sum(axis=0)) ** 2 / len(points)
    length = np.hypot(*waves.T)
    rings = np.arange(1, size)
    return rings, np.array([power[np.abs(length - ring) < 0.5].mean() for ring in rings])


def test_the_spectrum_of_blue_noise_has_its_gap() -> None:
    """On the flat front of a box that the map leaves as it is. White noise has power 1 everywhere."""
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 7), np.linspace(-1.5, 1.5, 7), indexing="ij")
    index = np.arange(49).reshape(7, 7)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    flat = Asset(small_content((np.stack([x, y, 0 * x], -1).reshape(-1, 3), faces), amplitude=0.0))
    blue = blue_noise(flat, radius_for(flat, 2000), seed=4)
    white = white_noise(flat, len(blue.points), seed=4)
    rings, power = spectrum(blue.points[:, :2], 3.0)
    _, noise = spectrum(white.points[:, :2], 3.0)
    # Border effects of the square, which is not periodic, fall into the axes alone: medians would hide nothing else.
    low = (rings > 2) & (rings < 0.6 * np.sqrt(len(blue.points)))
    assert np.median(power[low]) < 0.15
    assert np.median(noise[low]) == pytest.approx(1, abs=0.3)


def test_the_same_seed_gives_the_same_points() -> None:
    assert np.array_equal(white_noise(ROUGH, 50, 7).points, white_noise(ROUGH, 50, 7).points)
    assert not np.array_equal(white_noise(ROUGH, 50, 7).points, white_noise(ROUGH, 50, 8).points)


def test_what_is_wrong_is_said() -> None:
    for call, message in [
        (lambda: white_noise(ROUGH, 0), "ask for 1 to"),
        (lambda: blue_noise(ROUGH, 0.0), "must be positive"),
        (lambda: blue_noise(ROUGH, 1e-5), "too many"),
        (lambda: radius_for(ROUGH, 0), "at least 1"),
    ]:
        with pytest.raises(ConfigError, match=message):
            call()
