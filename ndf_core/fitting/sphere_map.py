"""A map from a base mesh of genus 0 to a surface that folds nowhere: both are drawn on one sphere.

The surface is drawn first (`sphere_drawing.py`). A coarse drawing of the base mesh is led to where its anchors belong
on top of the surface's, and is refined there, by the surface's lengths: so a limb gets its share of triangles however
small its drawing is. No closest point is asked for before everything is in place, so nothing spans two limbs. In the
end its vertices settle (`sphere_settling.py`).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.fitting.registration import PlacedAnchors, Target
from ndf_core.fitting.sphere_distortion import Metric
from ndf_core.fitting.sphere_drawing import SphereDrawing, dragged, ways
from ndf_core.fitting.sphere_settling import settled
from ndf_core.fitting.sphere_surface import DrawnSurface
from ndf_core.mesh import face_normals, interpolate, unit

_PUT_RIGHT = 20
"""Steps in which anchors go from a vertex of their triangle to where they are exactly ..."""
_BESIDE = 0.15
"""... and take along what is so near, in radians."""


class SphereMap:
    """From points of a base mesh to points of a surface, one to one."""

    steps = 600
    """Of training that the networks need to follow it; it is not linear on faces."""

    def __init__(
        self,
        vertices: Float[Array, "v 3"],
        faces: Int[Array, "f 3"],
        target: Target,
        anchors: PlacedAnchors,
    ) -> None:
        """Draw both.

        Args:
            vertices, faces: the base mesh, of genus 0 and one component.
            target: of the same topology.
            anchors: points of the base mesh, with goals on the target.

        Raises:
            FitError: the anchors cannot all be reached without folds, or a mesh is too degenerate.
        """
        self._surface, self._faces = DrawnSurface(target), faces
        drawn = self._base_mesh(vertices, anchors)
        fixed = np.zeros(len(vertices), dtype=bool)
        fixed[faces[anchors.faces]] = True
        area, own = (
            np.linalg.norm(face_normals(*mesh), axis=1).sum()
            for mesh in ((target.vertices, target.faces), (vertices, faces))
        )
        self._drawn = settled(drawn, vertices * np.sqrt(area / own), faces, fixed, self._surface)

    @property
    def vertices(self) -> Float[Array, "v 3"]:
        """Those of the base mesh, on the target."""
        return self._surface.points(self._drawn)

    def at(self, faces: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Points of the target for points of the base mesh."""
        return self._surface.points(unit(interpolate(self._drawn, self._faces[faces], weights)))

    def _base_mesh(self, vertices: Float[Array, "v 3"], anchors: PlacedAnchors) -> Float[Array, "v 3"]:
        """Draw it so that anchors are at their goals."""
        surface = self._surface
        metric = Metric(surface.vertices, surface.faces, surface.drawn)
        goals = surface.places(anchors.goals)
        nearest = self._faces[anchors.faces, anchors.weights.argmax(axis=1)]
        kept, which = np.unique(nearest, return_index=True)
        drawing = SphereDrawing(vertices, self._faces, kept)
        drawing.grow(drawing.coarse)
        drawing.lead(kept, goals[which])
        fixed = np.zeros(len(vertices), dtype=bool)
        fixed[kept] = True
        drawing.grow(len(vertices), fixed, metric)
        drawn = drawing.positions
        for step in range(_PUT_RIGHT):
            places = unit(interpolate(drawn, self._faces[anchors.faces], anchors.weights))
            moved = dragged(drawn, places, ways(places, goals) / (_PUT_RIGHT - step), _BESIDE)
            if ((face_normals(moved, self._faces) * moved[self._faces[:, 0]]).sum(axis=1) <= 0).any():
                break  # what is left is for the anchor loss
            drawn = moved
        return drawn
