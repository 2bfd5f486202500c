"""Surfaces whose distances and spectra are known in closed form."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from solids import sheet

from ndf_core.kernels.delaunay import IntrinsicTriangulation
from ndf_core.kernels.mesh_check import check_mesh
from ndf_core.mesh import face_normals
from ndf_core.processing.operators import Operators

Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]


class FlatTorus(Operators):
    """The unit square with opposite sides glued: lengths that no triangles in space have.

    The vertices are the square's, and mean nothing beyond it.
    """

    def __init__(self, side: int) -> None:
        i, j = (index.ravel() for index in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
        right, above = (i + 1) % side, (j + 1) % side
        a, b, c, d = i * side + j, right * side + j, right * side + above, i * side + above
        faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)
        super().__init__(np.stack([i, j, 0 * i], axis=1) / side, faces)
        self._side = side

    @cached_property
    def triangulation(self) -> IntrinsicTriangulation:
        step = self.vertices[self.faces[:, [1, 2, 0]]] - self.vertices[self.faces]
        lengths = np.linalg.norm(step - np.rint(step), axis=2)
        return IntrinsicTriangulation(self.faces, lengths, check_mesh(self.faces, len(self.vertices)).twins)

    def distances(self, source: int) -> Float[Array, " v"]:
        step = self.vertices - self.vertices[source]
        return np.linalg.norm(step - np.rint(step), axis=1)

    @staticmethod
    def eigenvalues(count: int) -> Float[Array, " k"]:
        m = np.arange(-count, count + 1)
        return np.sort((4 * np.pi**2 * (m[:, None] ** 2 + m**2)).ravel())[:count]


def pillow(side: int = 8) -> Mesh:
    """Two unit squares in the plane z = 0, glued along their border: closed, flat but for four corners."""
    vertices, faces = sheet(side)
    quads = side * side
    for quad in (side - 1, quads - side):  # their diagonals would join two borders and so be on both squares
        (a, b, c), (_, _, d) = faces[quad], faces[quad + quads]
        faces[quad], faces[quad + quads] = (a, b, d), (b, c, d)
    inner = ((vertices[:, :2] > 0) & (vertices[:, :2] < 1)).all(axis=1)
    back = np.arange(len(vertices))
    back[inner] = len(vertices) + np.arange(inner.sum())
    return np.concatenate([vertices, vertices[inner]]), np.concatenate([faces, back[faces[:, ::-1]]]).astype(np.int32)


def pillow_distances(vertices: Float[Array, "v 3"], side: int, source: Float[Array, "2"]) -> Float[Array, " v"]:
    """From a point of the front: straight to the front, and over the nearest of four borders to the back."""
    front = (side + 1) ** 2
    points = vertices[:, :2]
    straight = np.linalg.norm(points - source, axis=1)
    mirrored = [points * [-1, 1], points * [1, -1], [2, 0] + points * [-1, 1], [0, 2] + points * [1, -1]]
    around = np.min([np.linalg.norm(image - source, axis=1) for image in mirrored], axis=0)
    return np.where(np.arange(len(vertices)) < front, straight, around)


def pillow_eigenvalues(count: int) -> Float[Array, " k"]:
    """Even functions have the square's Neumann eigenvalues, odd ones its Dirichlet eigenvalues."""
    m = np.arange(count)
    values = (np.pi**2 * (m[:, None] ** 2 + m**2)).ravel()
    both = (m[:, None] * m).ravel() > 0
    return np.sort(np.concatenate([values, values[both]]))[:count]


def rough_sphere(count: int = 300, seed: int = 0, squeeze: float = 1.0) -> Mesh:
    """Convex hull of random points on a sphere, which is squeezed along z afterwards: obtuse and thin triangles."""
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(seed).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices
    outward = np.einsum("fi,fi->f", face_normals(points, faces), points[faces[:, 0]]) > 0
    faces = np.where(outward[:, None], faces, faces[:, ::-1]).astype(np.int32)
    return points * [1.0, 1.0, squeeze], faces


def spindle(valence: int = 500) -> Mesh:
    """Two tips of high valence, joined over a narrow ring: needles only."""
    angle = 2 * np.pi * np.arange(valence) / valence
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(valence)], axis=1) * 1e-3
    i = np.arange(valence)
    k = (i + 1) % valence
    top, bottom = valence, valence + 1
    faces = np.concatenate([np.stack([i, k, 0 * i + top], axis=1), np.stack([k, i, 0 * i + bottom], axis=1)])
    return np.concatenate([ring, [[0, 0, 1.0], [0, 0, -1.0]]]), faces.astype(np.int32)
