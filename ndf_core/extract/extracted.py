"""`ExtractedMesh`: a triangle mesh of the surface and where each of its vertices lies on the base mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.delaunay import IntrinsicTriangulation
from ndf_core.mesh import interpolate


@dataclass(frozen=True)
class ExtractedMesh:
    """Laws: closed and manifold wherever the base mesh is, with its Euler characteristic; no edge is longer than
    `edge_length`, but for `unsplit_edges`; `vertices` are the field at (`base_faces`, `barycentric`).
    """

    vertices: Float[Array, "v 3"]
    """float64, input units."""
    faces: Int[Array, "f 3"]
    """int32, counter-clockwise seen from outside."""
    base_faces: Int[Array, " v"]
    """int32: the base face that each vertex lies in."""
    barycentric: Float[Array, "v 3"]
    """float64: its weights there."""
    edge_lengths: Float[Array, "f 3"]
    """float64, input units: `edge_lengths[f, i]` is that of the edge from corner i of face f to the next, measured
    along the surface: over the field at its middle. Of the flat triangles where extraction did not measure edges."""
    intrinsic: IntrinsicTriangulation
    """The intrinsic Delaunay triangulation of these lengths, to compute on: its area, angles and distances are closer
    to the surface's than those of the flat triangles. Input units."""
    edge_length: float
    """Input units."""
    statistics: Mapping[str, Any]
    """JSON-ready: `manifold` and `closed`; `euler_characteristic`; `delaunay`, the share of Delaunay edges of
    `intrinsic`, and `delaunay_extrinsic`, that of `faces`; `folded_area`, the share of the area in faces that have a
    neighbour folded over them; `unsplit_edges`, longer ones that could not be split; `seconds` by stage."""

    def locate(
        self, points: Float[Array, "n 3"], threads: int = 1
    ) -> tuple[Int[Array, " n"], Float[Array, "n 3"], Float[Array, " n"]]:
        """The closest point of the mesh to each point, say of the original surface: face, weights there, distance.

        Laws: rows are independent; a vertex of the mesh is found exactly, at distance 0.

        Args:
            points: Input units, any distance from the mesh.
            threads: Rows are shared out over this many threads.

        Raises:
            ValueError: a point is not finite.
        """
        closest, faces, weights = self.tree.closest(points, threads)
        return faces, weights, np.linalg.norm(closest - points, axis=1)

    def interpolate(
        self, values: Float[Array, "v *k"], points: Float[Array, "n 3"], threads: int = 1
    ) -> Float[Array, "n *k"]:
        """Values at the vertices, such as a solution, brought to points near the mesh (end of Sec. 3.4).

        Laws: exact at vertices; linear in `values`; constants stay.

        Raises:
            ValueError: there is not one value per vertex, or a point is not finite.
        """
        if len(values) != len(self.vertices):
            raise ValueError(f"values: need {len(self.vertices)} rows, one per vertex, got {len(values)}")
        faces, weights, _ = self.locate(points, threads)
        return interpolate(values, self.faces[faces], weights)

    @cached_property
    def tree(self) -> TriangleBVH:
        """The index behind `locate`; made when first needed."""
        return TriangleBVH(self.vertices, self.faces)

    @cached_property
    def self_intersections(self) -> int:
        """How many pairs of faces cross; counted when first asked for, in about as long as extraction took."""
        return len(self.tree.self_intersections())
