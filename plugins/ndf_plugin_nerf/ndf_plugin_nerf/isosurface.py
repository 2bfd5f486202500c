"""The zero level set of numbers on a grid as closed triangles, and points spread evenly over it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.lattice import Lattice, distinct
from ndf_core.base_mesh.marching_cubes import marching_cubes
from ndf_core.base_mesh.narrow_band import Band, block_corners
from ndf_core.mesh import face_normals
from ndf_plugin_nerf.lattice import Nodes

Triangles = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]


def isosurface(nodes: Nodes, values: Float[Array, "x y z"]) -> Triangles:
    """Marching cubes of values that are negative inside; what reaches the sides of the grid is closed there.

    Returns:
        Vertices (float64, input units) and faces (int32), a closed manifold, normals outwards; empty where nothing is
        inside.
    """
    inner = np.array(nodes.counts) - 1
    # As marching cubes wants it: one layer of corners beyond the bounds, where everything is outside.
    lattice = Lattice(nodes.box.lower, nodes.step, inner, inner + 2, 2)
    padded = np.pad(values.astype(np.float64), 1, constant_values=np.inf)
    inside = padded < 0
    some, all_of = inside, inside
    for axis in range(3):
        some, all_of = (np.moveaxis(part, axis, 0) for part in (some, all_of))
        some = some[:-1:2] | some[1::2] | some[2::2]
        all_of = all_of[:-1:2] & all_of[1::2] & all_of[2::2]
        some, all_of = (np.moveaxis(part, 0, axis) for part in (some, all_of))
    crossed = np.argwhere(some & ~all_of)
    blocks = distinct(lattice.cell_keys(crossed, 2))
    corners = block_corners(lattice, blocks)
    band = Band.of(lattice, blocks, corners, padded[tuple(lattice.corner_index(corners).T)])
    return marching_cubes(band)


def sample_triangles(
    triangles: Triangles, count: int, rng: np.random.Generator
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """`count` points even by area, and the normals of their triangles; input units."""
    vertices, faces = triangles
    area_vectors = face_normals(vertices, faces)
    area = np.linalg.norm(area_vectors, axis=1)
    face = rng.choice(len(area), size=count, p=area / area.sum())
    # Uniform in a triangle: the parallelogram's coordinates, folded over its diagonal.
    u, v = rng.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    a, b, c = (vertices[faces[face, i]] for i in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), area_vectors[face] / area[face, None]
