"""`ExtractedMesh`: a triangle mesh of the surface and where each of its vertices lies on the base mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.delaunay import IntrinsicTriangulation


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
    intrinsic: IntrinsicTriangulation
    """The intrinsic Delaunay triangulation of `faces`, to compute on; input units."""
    edge_length: float
    """Input units."""
    statistics: Mapping[str, Any]
    """JSON-ready: `manifold` and `closed`; `euler_characteristic`; `delaunay`, the share of Delaunay edges of
    `intrinsic`, and `delaunay_extrinsic`, that of `faces`; `folded_area`, the share of the area in faces that have a
    neighbour folded over them; `unsplit_edges`, longer ones that could not be split; `seconds` by stage."""
