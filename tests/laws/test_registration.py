"""Drawing a mesh over another: anchors met, nothing folded, the same in every frame."""

from __future__ import annotations

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray as Array
from small_assets import icosphere

from ndf_core.fitting.registration import PlacedAnchors, Target, register

VERTICES, FACES = icosphere(2)
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
AXES = np.array([1.4, 0.6, 0.8])


def dumbbell() -> tuple[Float[Array, "v 3"], Array]:
    """Two bulbs and a neck along x, 3 long: far from star-shaped normals at the neck."""
    points, faces = icosphere(3)
    along = np.arccos(np.clip(-points[:, 0], -1, 1)) / np.pi
    width = 0.55 - 0.3 * np.exp(-(((along - 0.5) / 0.12) ** 2))
    ring = points[:, 1:] / np.maximum(np.linalg.norm(points[:, 1:], axis=1, keepdims=True), 1e-12)
    radius = width * np.sqrt(np.clip(1 - (2 * along - 1) ** 6, 0, None))
    return np.column_stack([3 * along - 1.5, radius[:, None] * ring]), faces


def on_vertices(rows: list[int], goals: Float[Array, "m 3"]) -> PlacedAnchors:
    """Anchors at vertices of the sphere."""
    faces = np.array([int(np.flatnonzero((row == FACES).any(axis=1))[0]) for row in rows])
    return PlacedAnchors(faces, (FACES[faces] == np.array(rows)[:, None]).astype(float), goals)


@pytest.mark.slow
class TestRegister:
    def test_an_ellipsoid_met_after_a_quarter_turn(self) -> None:
        """Anchors turn the sphere by 90 degrees around z; the map goes along, though closest points would not."""
        points, faces = icosphere(4)
        target = Target(points * AXES, faces)
        rows = list(range(12))  # corners of the icosahedron
        anchors = on_vertices(rows, target.tree.closest((VERTICES[rows] @ TURN.T) * AXES)[0])
        found = register(VERTICES, FACES, target, anchors, seed=0)
        assert np.abs(found[rows] - anchors.goals).max() < 1e-9
        assert not target.folded(found, FACES).any()
        distance = np.linalg.norm(target.tree.closest(found)[0] - found, axis=1)
        assert distance.mean() < 0.02
        assert distance.max() < 0.1, "edges are half a unit long: so far do tangents leave round spots"
        assert np.linalg.norm(found / AXES - VERTICES @ TURN.T, axis=1).max() < 0.4

    def test_a_neck_is_entered_from_both_sides(self) -> None:
        points, faces = dumbbell()
        target = Target(points, faces)
        rows = [int(np.argmin(VERTICES @ np.array([sign, 0.0, 0.0]))) for sign in (1.0, -1.0)]
        goals = np.array([[-1.5, 0.0, 0.0], [1.5, 0.0, 0.0]])
        found = register(VERTICES, FACES, target, on_vertices(rows, goals), seed=0)
        folded = target.folded(found, FACES)
        assert folded.mean() < 0.01
        distance = np.linalg.norm(Target(found, FACES).tree.closest(points)[0] - points, axis=1)
        assert distance.mean() < 0.05, "all of the target is covered"

    def test_the_same_in_every_frame(self) -> None:
        points, faces = icosphere(3)
        rows = list(range(12))
        goals = VERTICES[rows] * AXES
        goals = Target(points * AXES, faces).tree.closest(goals)[0]
        here = register(VERTICES, FACES, Target(points * AXES, faces), on_vertices(rows, goals), seed=3)
        turned = Target((points * AXES) @ TURN.T, faces)
        there = register(VERTICES @ TURN.T, FACES, turned, on_vertices(rows, goals @ TURN.T), seed=3)
        # Not to rounding: a closest point on an edge has the normal of either face, and steps hang on it.
        assert np.abs(there - here @ TURN.T).max() < 0.03
