"""A surface of genus 0 that is drawn on the unit sphere: from the one to the other and back."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.fitting.registration import Target
from ndf_core.fitting.sphere_distortion import edge_columns
from ndf_core.fitting.sphere_drawing import SphereDrawing
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import interpolate, unit, vertex_normals

_DRAWN_FACES = 5_000
"""What is finer is landed on."""


class DrawnSurface:
    """Of a coarsened mesh of it: `vertices`, `faces`, and where the vertices are `drawn`."""

    def __init__(self, target: Target) -> None:
        """Draw it.

        Raises:
            FitError: it is of another genus, or too degenerate.
        """
        coarse = coarsen(target.vertices, target.faces, min(_DRAWN_FACES, len(target.faces)))
        self.vertices, self.faces, self._target = coarse.vertices, coarse.faces, target
        drawing = SphereDrawing(coarse.vertices, coarse.faces)
        drawing.grow(len(coarse.vertices))
        self.drawn = drawing.positions
        self._tree = TriangleBVH(self.drawn, self.faces)
        surface, sphere = (edge_columns(points, self.faces) for points in (self.vertices, self.drawn))
        self._back = sphere @ np.linalg.pinv(surface)
        self._normals = vertex_normals(target.vertices, target.faces)

    def places(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Where points of the surface are drawn."""
        _, at, weights = TriangleBVH(self.vertices, self.faces).closest(points)
        return unit(interpolate(self.drawn, self.faces[at], weights))

    def points(self, drawn: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """What is drawn at unit vectors."""
        return self.landed(drawn)[0]

    def landed(
        self, drawn: Float[Array, "n 3"]
    ) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"], Float[Array, "n 3 3"]]:
        """`points`, the surface's normals there, and from small steps along it to those along the drawing."""
        _, at, inside = self._tree.closest(drawn)
        points, on, weights = self._target.tree.closest(interpolate(self.vertices, self.faces[at], inside))
        return points, unit(interpolate(self._normals, self._target.faces[on], weights)), self._back[at]
