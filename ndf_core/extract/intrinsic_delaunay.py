"""The intrinsic Delaunay triangulation of any oriented mesh: what to compute on."""

from __future__ import annotations

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.errors import InputError
from ndf_core.kernels.delaunay import IntrinsicTriangulation, flip_to_delaunay, straight_lengths
from ndf_core.kernels.mesh_check import check_mesh


def intrinsic_delaunay(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], lengths: Float[Array, "f 3"] | None = None
) -> IntrinsicTriangulation:
    """Flip edges, on lengths alone, until the opposite angles of every inner edge add up to pi at most.

    The surface stays that of `faces`, or the one that the lengths describe; loops and double edges may appear. Its
    Laplacian has no negative weight.

    Laws: the same on every run; a mesh that is Delaunay already stays as it is; vertices, area and the angle sum at
    every vertex stay.

    Args:
        vertices: Any units.
        faces: An oriented manifold along its edges; a border is allowed, and so are faces without area.
        lengths: Of the half-edges, where they are not straight.

    Raises:
        InputError: an edge has more than two faces, or two that run through it in the same direction; a face names a
            vertex twice or one that does not exist; or a vertex is not finite.

    Reference: Fisher, Springborn, Schroeder, Bobenko 2007; Sharp, Soliman, Crane 2019.
    """
    if not np.isfinite(vertices).all():
        raise InputError("the mesh has vertices that are not finite")
    try:
        check = check_mesh(faces, len(vertices))
    except IndexError as error:
        raise InputError(f"the mesh is damaged: {error}") from error
    if check.non_manifold_edges or check.inconsistent_edges or check.degenerate_faces:
        raise InputError(
            f"the mesh is not an oriented manifold: {check.non_manifold_edges} edges of more than two faces, "
            f"{check.inconsistent_edges} of two that disagree, {check.degenerate_faces} degenerate faces"
        )
    straight = straight_lengths(vertices, faces) if lengths is None else lengths
    triangulation, _ = flip_to_delaunay(straight, faces, check.twins)
    return triangulation
