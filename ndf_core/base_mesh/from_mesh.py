"""The base mesh of a closed triangle mesh: the mesh itself decimated, or marching cubes of its signed distance."""

from __future__ import annotations

from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import inside_out_components, longest_side
from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.crumbs import compact, drop_crumbs, largest_component
from ndf_core.base_mesh.intersections import intersecting_area, intersection_remark, self_intersections
from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.base_mesh.mesh_distance import MeshDistance
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, Remark
from ndf_core.mesh import Topology, face_components, signed_volume, topology

TOLERATED_AREA = 0.05
"""With "auto", a mesh is decimated if at most this share of its area is in faces that intersect others."""
MIN_COMPONENT = 0.005
"""Components with a smaller bounding-box diagonal, as a share of that of the largest component, are left out."""
MARGIN = 0.02
"""Room around the mesh for marching cubes, as a share of its longest side."""

Method = Literal["auto", "decimate", "marching_cubes"]


class MeshExtractor(BaseMeshExtractor):
    """Base mesh of a closed mesh.

    "decimate" keeps the mesh's topology exactly and needs a manifold mesh; "marching_cubes" gives the boundary of
    the union of what the mesh encloses, so overlapping parts become one; "auto" decimates a manifold mesh that does
    not intersect itself, or only in 5% of its area, and takes marching cubes otherwise.

    Remarks: "flipped" (components that were inside out), "dropped_component", "filled_cavity",
    "self_intersections" (of the input or of the base mesh), "topology_changed" (against a manifold input), and those
    of `LevelSetExtractor`.
    """

    def __init__(
        self,
        vertices: Float[Array, "v 3"],
        faces: Int[Array, "f 3"],
        *,
        method: Method = "auto",
        policy: LevelSetPolicy | None = None,
    ) -> None:
        """Check the mesh.

        Args:
            vertices: Input units; equal points must have been merged.
            faces: Counter-clockwise seen from outside; components that are inside out are flipped.
            policy: For marching cubes.

        Raises:
            BaseMeshError: the mesh is empty, not finite or not closed, or not manifold with `method` "decimate".
        """
        vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int32)
        if not len(faces) or not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
            raise BaseMeshError("a mesh needs at least one face, finite vertices and face indices in range")
        self._vertices, self._faces = compact(vertices, faces)
        counts = topology(self._faces, len(self._vertices))
        if not counts.closed:
            raise BaseMeshError(
                f"the mesh is not closed: {counts.boundary_edges} of {counts.edges} edges have one face. "
                f"Close its holes, or open it as a polygon soup (--repr soup)"
            )
        if method == "decimate" and not counts.manifold:
            raise BaseMeshError(f"only a manifold mesh can be decimated: {_faults(counts)}; use marching cubes")
        self._counts = counts
        self._method: Method = method
        self._policy = policy

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh; `seed` is not used, nothing here is random."""
        del seed
        vertices, faces, remarks = self._vertices, self._faces, list[Remark]()
        if not self._counts.manifold:
            remarks.append(Remark("not_manifold", f"the mesh is not manifold: {_faults(self._counts)}"))
            return self._by_marching_cubes(vertices, faces, max_faces, remarks)
        faces, remarks = _outwards(vertices, faces, self._counts.components)
        if self._method != "marching_cubes":
            pairs = self_intersections(vertices, faces)
            if len(pairs):
                remarks.append(intersection_remark(vertices, faces, pairs, "the input"))
            if self._method == "decimate" or intersecting_area(vertices, faces, pairs) <= TOLERATED_AREA:
                if self._counts.components > 1:
                    least = MIN_COMPONENT * largest_component(vertices, faces)
                    vertices, faces, dropped = drop_crumbs(vertices, faces, least)
                    remarks += dropped
                return coarsen(vertices, faces, max_faces, remarks=remarks)
        return self._by_marching_cubes(vertices, faces, max_faces, remarks)

    def _by_marching_cubes(
        self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], max_faces: int, remarks: list[Remark]
    ) -> BaseMesh:
        distance = MeshDistance(vertices, faces)
        margin = MARGIN * longest_side(vertices)
        bounds = np.stack([vertices.min(axis=0) - margin, vertices.max(axis=0) + margin])
        dense = LevelSetExtractor(
            distance.signed, bounds, lipschitz=1.0, distance=distance.unsigned, policy=self._policy
        ).dense()
        remarks = [*remarks, *dense[2], *_changed(self._counts, topology(dense[1], len(dense[0])))]
        return coarsen(dense[0], dense[1], max_faces, remarks=remarks)


def _outwards(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], components: int
) -> tuple[Int[Array, "f 3"], list[Remark]]:
    """Turn round the components that are inside out; a mesh that is so as a whole is turned round as a whole."""
    remarks: list[Remark] = []
    if signed_volume(vertices, faces) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
        remarks.append(Remark("flipped", "the mesh was inside out and is turned round"))
    wrong = inside_out_components(vertices, faces) if components > 1 else []
    if len(wrong):
        rows = np.isin(face_components(faces, len(vertices)), wrong)
        faces = faces.copy()
        faces[rows] = faces[rows][:, ::-1]
        remarks.append(
            Remark("flipped", f"{len(wrong)} components were inside out and are turned round", count=len(wrong))
        )
    return faces, remarks


def _changed(before: Topology, after: Topology) -> list[Remark]:
    same = before.euler_characteristic == after.euler_characteristic and before.components == after.components
    if not before.manifold or same:
        return []
    message = (
        f"marching cubes gives {after.components} components with Euler characteristic {after.euler_characteristic}, "
        f"the input has {before.components} with {before.euler_characteristic}"
    )
    return [Remark("topology_changed", message)]


def _faults(counts: Topology) -> str:
    return (
        f"{counts.non_manifold_edges} edges with more than two faces, {counts.inconsistent_edges} edges between "
        f"oppositely oriented faces, {counts.non_manifold_vertices} vertices with several fans, "
        f"{counts.degenerate_faces} degenerate faces"
    )
