"""Tangent directions at the vertices of a mesh: angles of edges, transport, and back to space."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array, csc_array

from ndf_core.errors import InputError
from ndf_core.kernels.mesh_check import check_mesh
from ndf_core.processing.cholesky import Cholesky
from ndf_core.processing.operators import Operators
from ndf_core.processing.triangles import areas, cotangents, mollified

_ITERATIONS = 40
_TOLERANCE = 1e-9


class TangentFrames:
    """Directions at vertices as complex numbers: 1 points along the vertex's first edge, i to the left.

    Angles around an inner vertex are stretched to add up to 2 pi, so that the tangent plane is a plane. Works on the
    mesh's own triangles, not on the intrinsic Delaunay ones: a direction is to be drawn, and only edges that are
    straight lines in space say where it points.

    Reference: Knoppel, Crane, Pinkall, Schroeder 2013, Sec. 6.
    """

    def __init__(self, operators: Operators) -> None:
        """Link the half-edges.

        Raises:
            InputError: the mesh is no oriented manifold.
        """
        self.vertices, self.faces = operators.vertices, operators.faces
        check = check_mesh(self.faces, len(self.vertices))
        if not check.manifold:
            raise InputError(
                f"directions need an oriented manifold: the mesh has {check.non_manifold_edges} edges and "
                f"{check.non_manifold_vertices} vertices where surfaces meet, {check.inconsistent_edges} edges whose "
                "triangles disagree"
            )
        self.twins = check.twins
        self.euler_characteristic = check.euler_characteristic
        edges = self.vertices[self.faces[:, [1, 2, 0]]] - self.vertices[self.faces]
        self.lengths = mollified(np.linalg.norm(edges, axis=2))
        self.areas = areas(self.lengths)

    @cached_property
    def corner_angles(self) -> Float[Array, "f 3"]:
        """Angle of each corner, radians."""
        cotangent = np.roll(cotangents(self.lengths, self.areas), -1, axis=1)
        return np.arctan2(1.0, cotangent)

    @cached_property
    def angles(self) -> Float[Array, " h"]:
        """Direction of each half-edge 3 f + i at the vertex where it starts: angle to the vertex's first edge."""
        return self._turned[0]

    @cached_property
    def back_angles(self) -> Float[Array, " h"]:
        """Direction of each half-edge's reverse at the vertex where it ends; also at borders."""
        return self._turned[1]

    @cached_property
    def first_edges(self) -> Int[Array, " v"]:
        """The half-edge along which 1 points; at a border the one with all triangles to its left."""
        start = self.faces.ravel()
        first = np.full(len(self.vertices), -1, dtype=np.int64)
        first[start] = np.arange(len(start))
        border = np.flatnonzero(self.twins.ravel() < 0)
        first[start[border]] = border
        return first

    @cached_property
    def _turned(self) -> tuple[Float[Array, " h"], Float[Array, " h"]]:
        """Walk around all vertices at once, one corner at a time."""
        twins, corners = self.twins.ravel(), self.corner_angles.ravel()
        out, back = np.zeros(len(twins)), np.zeros(len(twins))
        vertex = np.arange(len(self.vertices))
        half, first = self.first_edges.copy(), self.first_edges
        total = np.zeros(len(self.vertices))
        while len(vertex):
            out[half] = total[vertex]
            total[vertex] += corners[half]
            incoming = half - half % 3 + (half + 2) % 3
            back[incoming] = total[vertex]
            half = twins[incoming].astype(np.int64)
            more = (half >= 0) & (half != first[vertex])
            vertex, half = vertex[more], half[more]
        border = np.zeros(len(self.vertices), dtype=bool)
        border[self.faces.ravel()[twins < 0]] = True
        stretch = np.where(border, 1.0, 2 * np.pi / total)
        end = np.roll(self.faces, -1, axis=1).ravel()
        return out * stretch[self.faces.ravel()], back * stretch[end]

    @cached_property
    def transport(self) -> Complex[Array, " h"]:
        """Along each half-edge: a direction z at its start is `transport * z` at its end (Levi-Civita)."""
        return np.exp(1j * (self.back_angles + np.pi - self.angles))

    @cached_property
    def edges(self) -> Int[Array, " e"]:
        """One half-edge of each edge."""
        twins = self.twins.ravel()
        return np.flatnonzero(twins < np.arange(len(twins)))

    @cached_property
    def weights(self) -> Float[Array, " h"]:
        """Cotangent weight of the edge of each half-edge; 0 where it would be negative, which needs obtuse angles."""
        half = 0.5 * cotangents(self.lengths, self.areas).ravel()
        twins = self.twins.ravel()
        return np.maximum(half + np.where(twins >= 0, half[twins], 0.0), 0.0)

    @cached_property
    def mass(self) -> Float[Array, " v"]:
        """A third of the area of the faces around each vertex."""
        return np.bincount(self.faces.ravel(), np.repeat(self.areas / 3, 3), minlength=len(self.vertices))

    def vectors(self, directions: Complex[Array, " v"]) -> Float[Array, "v 3"]:
        """Unit vectors in space: the first edge, in the plane across the vertex's normal, turned by the angle."""
        first = self.first_edges
        edge = (
            self.vertices[np.roll(self.faces, -1, axis=1).ravel()[first]] - self.vertices[self.faces.ravel()[first]]
        )
        normals = self._normals
        along = edge - (edge * normals).sum(axis=1, keepdims=True) * normals
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        unit = directions / np.maximum(np.abs(directions), 1e-300)
        return np.real(unit)[:, None] * along + np.imag(unit)[:, None] * np.cross(normals, along)

    def directions(self, vectors: Float[Array, "v 3"]) -> Complex[Array, " v"]:
        """The inverse of `vectors`, with the length of the tangential part; what is normal to the surface is lost."""
        one = np.ones(len(self.vertices), dtype=np.complex128)
        ahead, turned = self.vectors(one), self.vectors(1j * one)
        return (vectors * ahead).sum(axis=1) + 1j * (vectors * turned).sum(axis=1)

    @cached_property
    def _normals(self) -> Float[Array, "v 3"]:
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        vectors = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        corners = self.faces.ravel()
        sums = [np.bincount(corners, vectors[:, i], minlength=len(self.vertices)) for i in range(3)]
        total = np.stack(sums, axis=1)
        return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def hermitian(
    size: int, rows: Int[Array, " n"], columns: Int[Array, " n"], values: Complex[Array, " n"]
) -> csc_array:
    """A Hermitian matrix over `size` unknowns as a real symmetric one over twice as many: real parts, then imaginary.

    Args:
        size: Unknowns.
        rows, columns: Of one triangle's entries and the diagonal; the other triangle follows.
        values: Real on the diagonal.
    """
    other = rows != columns
    rows, columns = np.concatenate([rows, columns[other]]), np.concatenate([columns, rows[other]])
    values = np.concatenate([values, values[other].conj()])
    parts = [
        (0, 0, np.real(values)),
        (size, size, np.real(values)),
        (0, size, -np.imag(values)),
        (size, 0, np.imag(values)),
    ]
    entries = np.concatenate([part for _, _, part in parts])
    place = (
        np.concatenate([rows + row for row, _, _ in parts]),
        np.concatenate([columns + column for _, column, _ in parts]),
    )
    return csc_array(coo_array((entries, place), shape=(2 * size, 2 * size)))


def smallest_eigenvector(
    matrix: csc_array, mass: Float[Array, " n"], shift: float, start: Complex[Array, " n"]
) -> tuple[Complex[Array, " n"], float]:
    """The smallest eigenvalue of `matrix` z = lambda M z, after its eigenvector, by inverse iteration.

    Args:
        matrix: From `hermitian`, positive semidefinite.
        mass: Diagonal of M.
        shift: Times M is added before factorising; small beside the second eigenvalue.
        start: Anything that is not orthogonal to it.
    """
    both = np.concatenate([mass, mass])
    diagonal = np.arange(len(both))
    factor = Cholesky(csc_array(matrix + shift * csc_array(coo_array((both, (diagonal, diagonal))))))
    now = np.concatenate([np.real(start), np.imag(start)])
    now /= np.sqrt((both * now**2).sum())
    value = np.inf
    for _ in range(_ITERATIONS):
        now = factor.solve(both * now)
        now /= np.sqrt((both * now**2).sum())
        before, value = value, float(now @ (matrix @ now))
        if abs(before - value) <= _TOLERANCE * (abs(value) + shift):
            break
    half = len(mass)
    return now[:half] + 1j * now[half:], value
