"""What is measured, against the same thing computed in another way, on configurations that are known exactly."""

from __future__ import annotations

import math

import igl
import numpy as np
import pytest
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from small_assets import icosphere
from small_surfaces import (
    CENTER,
    RADIUS,
    Altered,
    GivenMesh,
    SphereProjector,
    nothing_converges,
    sphere_mesh,
    sphere_surface,
    torus_surface,
    upper_half_fails,
    without_normals,
)

import ndf_core
from ndf_core.fitting import measure as measure_module
from ndf_core.fitting.measure import Accuracy, dense_map, measure
from ndf_core.interfaces import Projection, Projector, Surface
from ndf_core.mesh import face_normals

POINTS, FACES = icosphere()
SCALE = RADIUS
"""The box frame here has the unit sphere: x_input = x_box * RADIUS + CENTER."""


@pytest.fixture(autouse=True)
def coarser(monkeypatch: pytest.MonkeyPatch) -> None:
    """A dense map of fewer triangles: flat faces need no more."""
    whole = measure_module.dense_map
    monkeypatch.setattr(measure_module, "dense_map", lambda count, mapping: whole(count, mapping, 80 * 16))


def identity(faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    return np.einsum("nc,ncx->nx", barycentric, POINTS[FACES[faces]])


def measured(mapping: object = identity, surface: Surface | None = None, **options: object) -> Accuracy:
    arguments = {"samples": 20_000, "inverse": None, **options}
    return measure(mapping, len(FACES), surface or sphere_surface(), np.array(CENTER), SCALE, identity, **arguments)


def gap_moments() -> tuple[float, float]:
    """Mean and mean square of 1 - |x| over the icosphere, by a fine midpoint rule: its distance from its sphere."""
    dense = dense_map(len(FACES), identity, 80 * 24**2)
    area = np.linalg.norm(face_normals(dense.vertices, dense.triangles), axis=1)
    gap = 1 - np.linalg.norm(dense.vertices[dense.triangles].mean(axis=1), axis=1)
    return float((area * gap).sum() / area.sum()), float((area * gap**2).sum() / area.sum())


class TestIdentityOverTheIcosphere:
    def test_field_to_surface(self) -> None:
        mean, square = gap_moments()
        found = measured().field_to_surface
        # Spread of 20,000 samples: the deviation of gap^2 is at most its mean here, so 4 sigma are below 3%.
        assert found.rms == pytest.approx(math.sqrt(square) / 3, rel=0.02)
        assert found.mean == pytest.approx(mean / 3, rel=0.02)
        # The deepest points are the middles of faces.
        deepest = 1 - np.linalg.norm(POINTS[FACES].mean(axis=1), axis=1).min()
        assert 0.97 * deepest < 3 * found.max <= deepest + 1e-6
        assert found.mean < found.rms < found.p99 < found.max

    def test_surface_to_field(self) -> None:
        surface = sphere_surface()
        assert surface.sample is not None
        points = (surface.sample(20_000, np.random.default_rng(5))[0] - np.array(CENTER)) / SCALE
        squared = igl.point_mesh_squared_distance(points, POINTS, FACES.astype(np.int64))[0]
        found = measured(surface=surface).surface_to_field
        assert found is not None
        assert found.rms == pytest.approx(math.sqrt(squared.mean()) / 3, rel=0.02)
        assert found.max == pytest.approx(math.sqrt(squared.max()) / 3, rel=0.05)

    def test_the_rest(self) -> None:
        found = measured()
        assert found.folded_area == 0 and found.converged == 1 and found.cycle_loss is None
        assert found.samples == 20_000
        assert found.surface_to_field is not None
        assert found.two_sided_rms == max(found.field_to_surface.rms, found.surface_to_field.rms)
        assert measured() == found, "seeded"
        assert measured(seed=1) != found

    def test_units_do_not_matter(self) -> None:
        """Shares of the longest side stay when the input is a thousand times as large and far away."""
        center, scale = (4e5, 0.0, -7e5), 1000.0
        surface = Surface("sphere", GivenMesh((POINTS, FACES)), SphereProjector(center, scale), "ab" * 32)
        large = measure(identity, len(FACES), surface, np.array(center), scale, identity, samples=20_000)
        small, found = measured().field_to_surface, large.field_to_surface
        assert (found.rms, found.mean, found.max) == pytest.approx((small.rms, small.mean, small.max), rel=1e-4)


def test_samples_are_even_by_mapped_area() -> None:
    """One face blown up sixfold along its edges, and so its part of the sum."""

    def blown_up(faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        points = identity(faces, barycentric)
        middle = POINTS[FACES[7]].mean(axis=0)
        return np.where((faces == 7)[:, None], middle + 6 * (points - middle), points)

    areas = np.linalg.norm(face_normals(POINTS, FACES), axis=1)
    share = 36 * areas[7] / (areas.sum() + 35 * areas[7])
    counted: list[float] = []

    def count(faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        counted.append(float((faces == 7).mean()))
        return blown_up(faces, barycentric)

    measured(count)
    assert counted[-1] == pytest.approx(share, abs=4 * math.sqrt(share / 20_000))


class TestFolds:
    def test_a_flipped_face_is_its_share_of_the_area(self) -> None:
        """Two corners exchanged: the same points, the normal inwards."""
        flipped = 11

        def fold(faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
            turned = np.where((faces == flipped)[:, None], barycentric[:, [0, 2, 1]], barycentric)
            return identity(faces, turned)

        areas = np.linalg.norm(face_normals(POINTS, FACES), axis=1)
        share = areas[flipped] / areas.sum()
        assert measured(fold).folded_area == pytest.approx(share, abs=4 * math.sqrt(share / 20_000))

    def test_inside_out(self) -> None:
        assert measured(lambda faces, weights: identity(faces, weights[:, [0, 2, 1]])).folded_area == 1

    def test_across_a_sharp_edge_is_no_fold(self) -> None:
        """A tetrahedron moved inwards by t: nearer to the next face than t it faces against its projection."""
        corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
        faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
        across, inwards = face_normals(corners, faces), 0.02
        normals = across / np.linalg.norm(across, axis=1, keepdims=True)

        def moved(index: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
            return np.einsum("nc,ncx->nx", barycentric, corners[faces[index]]) - inwards * normals[index]

        surface = ndf_core.open((corners, faces), "mesh")
        found = measure(moved, 4, surface, np.zeros(3), 1.0, moved, samples=20_000)
        # cos a = 1 / 3 between faces: the strip along the three edges is t (1 / sin a + 1 / tan a) = sqrt(2) t wide.
        # Edges are sqrt(8) long, faces have the area 2 sqrt(3).
        assert found.against_area == pytest.approx(3 * np.sqrt(8) * np.sqrt(2) * inwards / (2 * np.sqrt(3)), rel=0.1)
        assert found.folded_area == 0


class TestFaults:
    def faulty(self, change: object, *, needs_directions: bool = False) -> Projector:
        return Altered(sphere_surface().projector, change, needs_directions=needs_directions)

    def test_rows_that_do_not_converge_are_left_out_and_counted(self) -> None:
        """The other half of the sphere looks the same."""
        found = measured(surface=sphere_surface(self.faulty(upper_half_fails)))
        assert found.converged == pytest.approx(0.5, abs=0.02)
        assert found.field_to_surface.rms == pytest.approx(measured().field_to_surface.rms, rel=0.03)

    def test_nothing_converges(self) -> None:
        found = measured(surface=sphere_surface(self.faulty(nothing_converges)))
        assert found.converged == 0
        assert found.field_to_surface.rms == math.inf

    def test_surfaces_without_normals_or_samples(self) -> None:
        found = measured(surface=sphere_surface(self.faulty(without_normals)))
        assert found.field_to_surface == measured().field_to_surface
        assert measured(surface=torus_surface()).surface_to_field is None

    def test_directions_are_the_normals_of_the_mapped_surface(self) -> None:
        checked: list[float] = []

        def look(query: torch.Tensor, answer: Projection) -> Projection:
            directions = projector.directions[-1]
            assert directions is not None and answer.normals is not None
            checked.append(float((directions * answer.normals).sum(1).min()))
            return answer

        projector = Altered(sphere_surface().projector, look, needs_directions=True)
        measured(surface=sphere_surface(projector))
        assert checked[0] > 0.9


class TestCycle:
    def test_exact_inverse(self) -> None:
        found = measured(lambda f, b: 2 * identity(f, b), inverse=lambda points: points / 2)
        assert found.cycle_loss == pytest.approx(0, abs=1e-12)

    def test_of_a_known_error(self) -> None:
        """Off by (0.1, 0.2, 0): 0.05 in the box frame, whatever the scale."""
        found = measured(inverse=lambda points: points + np.array([0.1, 0.2, 0.0]))
        assert found.cycle_loss == pytest.approx(0.05, rel=1e-5)


class TestDenseMap:
    @pytest.mark.parametrize("cuts", [1, 2, 5])
    def test_covers_every_face_once(self, cuts: int) -> None:
        dense = dense_map(len(FACES), identity, len(FACES) * cuts**2)
        assert len(dense.triangles) == len(FACES) * cuts**2
        coarse, fine = face_normals(POINTS, FACES), face_normals(dense.vertices, dense.triangles)
        owner = dense.base_faces[dense.triangles]
        assert (owner == owner[:, :1]).all()
        np.testing.assert_allclose(fine, coarse[owner[:, 0]] / cuts**2, atol=1e-9)
        np.testing.assert_allclose(identity(dense.base_faces, dense.barycentric), dense.vertices, atol=1e-12)


def test_the_sphere_of_the_tests_touches_its_mesh() -> None:
    points = sphere_mesh()[0]
    np.testing.assert_allclose(np.linalg.norm(points - np.array(CENTER), axis=1), RADIUS)
