"""Meshes of genus 0 drawn on the sphere, and maps between two of them: nothing is ever turned over."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float, Int
from numpy import ndarray as Array
from small_assets import icosphere, torus

from ndf_core.errors import FitError
from ndf_core.fitting.registration import PlacedAnchors, Target
from ndf_core.fitting.sphere_distortion import Distortion, Metric
from ndf_core.fitting.sphere_drawing import SphereDrawing
from ndf_core.fitting.sphere_map import SphereMap
from ndf_core.mesh import face_normals, unit

LEGS = unit(np.array([[1.0, 1, -1], [1, -1, -1], [-1, 1, -1], [-1, -1, -1]]))
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def table(level: int) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"]]:
    """A ball with four slender legs, three radii long."""
    points, faces = icosphere(level)
    points = unit(points)
    height = 2 * np.exp(-(np.arccos(np.clip(points @ LEGS.T, -1, 1)) ** 2) / 0.05).max(axis=1)
    return points * (1 + height)[:, None], faces


def turned_over(drawn: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> int:
    return int(((face_normals(drawn, faces) * drawn[faces[:, 0]]).sum(axis=1) <= 0).sum())


def corners_of(faces: Int[Array, "f 3"]) -> Int[Array, "c 3"]:
    corners = np.concatenate([faces, faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]])
    return corners[np.argsort(corners[:, 0], kind="stable")]


class TestDrawing:
    @pytest.mark.slow
    def test_no_triangle_is_turned_over_and_none_vanishes(self) -> None:
        vertices, faces = table(2)
        drawing = SphereDrawing(vertices, faces)
        drawing.grow(len(vertices))
        drawn = drawing.positions
        np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1)
        assert not turned_over(drawn, faces)
        before, after = (np.linalg.norm(face_normals(points, faces), axis=1) for points in (vertices, drawn))
        share = (after / after.sum()) / (before / before.sum())
        assert share.min() > 0.02
        assert share.max() < 10

    def test_a_sphere_is_drawn_as_it_is(self) -> None:
        vertices, faces = icosphere(1)
        drawing = SphereDrawing(vertices @ TURN + 5.0, faces)
        drawing.grow(len(vertices))
        here, there = drawing.positions @ drawing.positions.T, unit(vertices) @ unit(vertices).T
        assert np.abs(here - there).max() < 0.05

    @pytest.mark.slow
    def test_vertices_are_led_to_their_goals(self) -> None:
        """Three of them turn around their middle by a right angle, three stay."""
        vertices, faces = icosphere(2)
        points = unit(vertices)
        first = faces[0]
        kept = np.append(first, [int(np.argmin(points @ points[vertex])) for vertex in first])
        drawing = SphereDrawing(vertices, faces, kept)
        drawing.grow(drawing.coarse)
        axis = unit(points[first].sum(axis=0))
        goals = points[kept]
        goals[:3] = np.cross(axis, points[first]) + (points[first] @ axis)[:, None] * axis
        drawing.lead(kept, goals)
        np.testing.assert_allclose(drawing.positions[kept], goals, atol=1e-3)
        assert not turned_over(drawing.positions, faces)

    def test_another_genus_is_refused(self) -> None:
        with pytest.raises(FitError, match="genus 0"):
            SphereDrawing(*torus())


class TestDistortion:
    def test_moving_lowers_it_and_turns_nothing_over(self) -> None:
        vertices, faces = table(2)
        corners = corners_of(faces)
        drawn = unit(vertices + 0.05 * np.random.default_rng(0).standard_normal(vertices.shape))
        assert not turned_over(drawn, faces)
        distortion = Distortion(vertices, corners)
        for metric in (None, Metric(vertices, faces, unit(vertices))):
            if metric is not None:
                distortion.use(metric, drawn)
            before = total(distortion, corners, drawn)
            distortion.lower(drawn, 3)
            assert total(distortion, corners, drawn) < before
            assert not turned_over(drawn, faces)

    def test_fixed_vertices_stay(self) -> None:
        vertices, faces = table(1)
        fixed = np.arange(len(vertices)) % 3 == 0
        drawn = unit(vertices)
        Distortion(vertices, corners_of(faces), fixed).lower(drawn, 2)
        np.testing.assert_array_equal(drawn[fixed], unit(vertices)[fixed])
        assert (drawn[~fixed] != unit(vertices)[~fixed]).any()

    def test_the_metric_gives_the_surfaces_lengths(self) -> None:
        """An ellipsoid drawn by its directions: small steps are as long as on the ellipsoid, at the sphere's area."""
        points, faces = icosphere(5)
        points = unit(points)
        axes = np.array([2.0, 1.0, 0.5])
        metric = Metric(points * axes, faces, points)
        at = unit(np.random.default_rng(0).standard_normal((200, 3)))
        step = 1e-4 * np.cross(at, unit(np.random.default_rng(1).standard_normal((200, 3))))
        length = np.sqrt(np.einsum("ni,nij,nj->n", step, metric.at(at), step))
        scale = np.sqrt(8 * np.pi / np.linalg.norm(face_normals(points * axes, faces), axis=1).sum())
        np.testing.assert_allclose(length, scale * np.linalg.norm(step * axes, axis=1), rtol=0.1)


def total(distortion: Distortion, corners: Int[Array, "c 3"], drawn: Float[Array, "v 3"]) -> float:
    terms = distortion._terms(drawn, np.arange(len(corners)), drawn[corners[:, 0]])
    return float(terms.energy.sum())


@pytest.mark.slow
class TestMap:
    def test_legs_are_entered_and_nothing_is_folded(self) -> None:
        """Anchors at the tips, a quarter turn from where closest points would go."""
        vertices, faces = icosphere(2)
        points, target_faces = table(3)
        tips = unit(points)[[int(np.argmax(points @ leg)) for leg in LEGS]]
        goals = 3 * tips
        base = Target(unit(vertices), faces)
        _, at, weights = base.tree.closest(tips @ TURN)
        target = Target(points, target_faces)
        drawn = SphereMap(unit(vertices), faces, target, PlacedAnchors(at, weights, goals))
        edge = np.linalg.norm(vertices[faces[0, 0]] - vertices[faces[0, 1]])
        missed = np.linalg.norm(drawn.at(at, weights) - goals, axis=1)
        assert missed.max() < 2 * edge, "the rest is for the anchor loss"
        fine, fine_faces = icosphere(5)
        _, on, inside = base.tree.closest(unit(fine))
        mapped = drawn.at(on, inside)
        assert np.linalg.norm(target.tree.closest(mapped)[0] - mapped, axis=1).max() < 1e-9
        areas = np.linalg.norm(face_normals(mapped, fine_faces), axis=1)
        assert areas[target.folded(mapped, fine_faces)].sum() < 0.01 * areas.sum()
        missed = np.linalg.norm(Target(mapped, fine_faces).tree.closest(points)[0] - points, axis=1)
        assert missed.max() < 0.25
        assert missed.mean() < 0.01
