"""What everything computed on a mesh shares: triangulation, Laplacian, mass, gradient and factors, each made once."""

from __future__ import annotations

from functools import cached_property
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components

from ndf_core.errors import InputError
from ndf_core.extract.intrinsic_delaunay import intrinsic_delaunay
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.delaunay import IntrinsicTriangulation
from ndf_core.mesh import face_normals, interpolate
from ndf_core.processing.cholesky import Cholesky
from ndf_core.processing.surface_points import SurfacePoints
from ndf_core.processing.triangles import areas, corners_in_plane, cotangents, mollified

MassKind = Literal["lumped", "galerkin", "mean"]

_NO_AREA = 1e-14
"""Of a mesh's area over the square of its longest side."""


@runtime_checkable
class TriangleMesh(Protocol):
    """An `ExtractedMesh`, or anything else with vertices and faces."""

    @property
    def vertices(self) -> Float[Array, "v 3"]: ...

    @property
    def faces(self) -> Int[Array, "f 3"]: ...


class Operators:
    """Finite elements on the intrinsic Delaunay triangulation of a mesh, in the mesh's units.

    The surface is that of the mesh's triangles, exactly, or the one that given edge lengths describe. Only its
    triangulation is another one, whose faces may have loops and double edges. Values are on the mesh's vertices.

    Laws: invariant under rigid motions; no value is changed once it is made.
    """

    def __init__(
        self,
        vertices: Float[Array, "v 3"],
        faces: Int[Array, "f 3"],
        triangulation: IntrinsicTriangulation | None = None,
        edge_lengths: Float[Array, "f 3"] | None = None,
    ) -> None:
        """Check the mesh; nothing is computed yet.

        Args:
            vertices: Any units; every one is used by a face.
            faces: An oriented manifold along its edges. A border is allowed.
            triangulation: The intrinsic Delaunay triangulation of the mesh, where it is known.
            edge_lengths: Of the faces' edges, where the surface is not the triangles: from corner i to corner i + 1.

        Raises:
            InputError: there is no face, no area, or a vertex that no face uses. What else can be wrong with a mesh
                is said when the triangulation is first needed.
        """
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int32)
        if not len(self.faces):
            raise InputError("the mesh has no triangles")
        used = np.zeros(len(self.vertices), dtype=bool)
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise InputError(f"the mesh has a face that names a vertex outside 0..{len(self.vertices) - 1}")
        used[self.faces] = True
        if not used.all():
            raise InputError(
                f"{int((~used).sum()):,} of {len(used):,} vertices belong to no face, the first is vertex "
                f"{int(used.argmin())} (from 0): remove them"
            )
        if edge_lengths is None and triangulation is None:
            area = float(np.linalg.norm(face_normals(self.vertices, self.faces), axis=1).sum())
            if area <= _NO_AREA * float(np.ptp(self.vertices, axis=0).max()) ** 2:
                raise InputError("the mesh has no area: its vertices lie at one place or along a line")
        self.edge_lengths = edge_lengths
        self._given = triangulation

    @classmethod
    def of(cls, mesh: TriangleMesh) -> Operators:
        """The operators of an `ExtractedMesh`, which brings its triangulation, or of another mesh."""
        return cls(mesh.vertices, mesh.faces, getattr(mesh, "intrinsic", None), getattr(mesh, "edge_lengths", None))

    @cached_property
    def triangulation(self) -> IntrinsicTriangulation:
        """Intrinsic Delaunay: faces, lengths of their edges, and twins.

        Raises:
            InputError: the mesh is not an oriented manifold, or not finite.
        """
        return self._given or intrinsic_delaunay(self.vertices, self.faces, self.edge_lengths)

    @cached_property
    def lengths(self) -> Float[Array, "f 3"]:
        """Of the triangulation's edges, from corner i to corner i + 1; those of degenerate triangles mollified."""
        return mollified(self.triangulation.lengths)

    @cached_property
    def areas(self) -> Float[Array, " f"]:
        """Of the triangulation's faces."""
        return areas(self.lengths)

    @property
    def area(self) -> float:
        """Of the whole surface."""
        return float(self.areas.sum())

    @cached_property
    def laplacian(self) -> csc_array:
        """The cotangent Laplacian, positive semidefinite: u^T L u is the Dirichlet energy of u.

        Laws: rows sum to zero; no entry off the diagonal is positive (to rounding), since the triangulation is
        Delaunay; independent of the mesh's size.
        """
        weight = 0.5 * cotangents(self.lengths, self.areas).ravel()
        start, end = self._half_edges
        rows = np.concatenate([start, end, start, end])
        columns = np.concatenate([start, end, end, start])
        values = np.concatenate([weight, weight, -weight, -weight])
        return self._square(values, rows, columns)

    @cached_property
    def lumped_mass(self) -> Float[Array, " v"]:
        """A third of the area of the faces around each vertex."""
        count = len(self.vertices)
        return np.bincount(self.triangulation.faces.ravel(), np.repeat(self.areas / 3, 3), minlength=count)

    @cached_property
    def galerkin_mass(self) -> csc_array:
        """Integrals of products of hat functions: u^T M v is the integral of u v."""
        start, end = self._half_edges
        share = np.repeat(self.areas, 3) / 12
        rows, columns = np.concatenate([start, start, end]), np.concatenate([start, end, start])
        return self._square(np.concatenate([2 * share, share, share]), rows, columns)

    def mass(self, kind: MassKind = "mean") -> csc_array:
        """A mass matrix; all of them sum to the area.

        "mean", the mean of the other two, suits eigenvalues best: on equilateral triangles one errs by as much as the
        other, upwards and downwards, in the leading order. On unit spheres it is four times more accurate.
        """
        lumped = csc_array(diags_array(self.lumped_mass))
        if kind == "lumped":
            return lumped
        return self.galerkin_mass if kind == "galerkin" else csc_array(0.5 * (lumped + self.galerkin_mass))

    @cached_property
    def gradient(self) -> csr_array:
        """From values on v vertices to tangent vectors of f faces: 2 f rows, x then y of each face.

        The frame of a face: x along its edge 0, y to the left of it (`triangles.corners_in_plane`). The transposed
        matrix, applied to vectors times areas, is the negative divergence, integrated; and L is G^T A G.
        """
        faces, corners = self.triangulation.faces, corners_in_plane(self.lengths, self.areas)
        # The hat function of a corner rises across the opposite edge, by one over its height.
        across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        slope = np.stack([-across[..., 1], across[..., 0]], axis=-1) / (2 * self.areas[:, None, None])
        rows = 2 * np.arange(len(faces))[:, None, None] + np.arange(2)
        rows, columns = np.broadcast_arrays(rows, faces[:, :, None])
        shape = (2 * len(faces), len(self.vertices))
        return csr_array(coo_array((slope.ravel(), (rows.ravel(), columns.ravel())), shape=shape))

    @cached_property
    def components(self) -> Int[Array, " v"]:
        """Which connected part each vertex belongs to, from 0."""
        start, end = self.faces.ravel(), self.faces[:, [1, 2, 0]].ravel()
        graph = coo_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(len(self.vertices),) * 2)
        return np.asarray(connected_components(graph, directed=False)[1])

    @cached_property
    def poisson(self) -> Cholesky:
        """Factor of the Laplacian, for right sides that sum to zero on every component.

        One vertex of each component is grounded: adding to its diagonal entry changes nothing where the right side
        sums to zero, but that the solution is zero there.
        """
        _, first = np.unique(self.components, return_index=True)
        ground = np.zeros(len(self.vertices))
        ground[first] = self.laplacian.diagonal()[first]
        return Cholesky(csc_array(self.laplacian + diags_array(ground)))

    @cached_property
    def mean_edge_length(self) -> float:
        """Of the triangulation."""
        return float(self.lengths.mean())

    @cached_property
    def heat(self) -> Cholesky:
        """Factor of M + t L with the lumped mass: one implicit step of the heat equation.

        t is the mean edge length squared (Crane, Weischedel, Wardetzky 2013).
        """
        return self.heat_step(self.mean_edge_length**2)

    def heat_step(self, time: float) -> Cholesky:
        """Factor of M + time L, not kept."""
        return Cholesky(csc_array(diags_array(self.lumped_mass) + time * self.laplacian))

    def closest(self, points: Float[Array, "n 3"], threads: int = 1) -> SurfacePoints:
        """The closest points of the mesh.

        Raises:
            InputError: a point is not finite.
        """
        if not np.isfinite(points).all():
            raise InputError(f"the point {points[~np.isfinite(points).all(axis=1)][0].tolist()} is not finite")
        positions, faces, weights = self._tree.closest(points, threads)
        return SurfacePoints(faces, weights, positions, np.linalg.norm(positions - points, axis=1))

    def interpolate(self, values: Float[Array, "v *k"], points: SurfacePoints) -> Float[Array, "n *k"]:
        """Values on vertices, linear in between, at points of the mesh (the query of Sec. 3.4)."""
        return interpolate(values, self.faces[points.faces], points.barycentric)

    @cached_property
    def _tree(self) -> TriangleBVH:
        return TriangleBVH(self.vertices, self.faces)

    @cached_property
    def _half_edges(self) -> tuple[Int[Array, " h"], Int[Array, " h"]]:
        faces = self.triangulation.faces
        return faces.ravel(), faces[:, [1, 2, 0]].ravel()

    def _square(self, values: Float[Array, " n"], rows: Int[Array, " n"], columns: Int[Array, " n"]) -> csc_array:
        """Entries of a matrix over the vertices, summed where they coincide."""
        return csc_array(coo_array((values, (rows, columns)), shape=(len(self.vertices),) * 2))
