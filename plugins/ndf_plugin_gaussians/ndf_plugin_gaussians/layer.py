"""The pieces of the splats that are seen from outside, oriented outwards, and what takes their place where there are
none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_core.errors import InputError
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals
from ndf_plugin_gaussians.solid import Mesh, Solid
from ndf_plugin_gaussians.surfels import Surfels

_SLACK = 1.25
"""Pieces deeper below the solid's boundary than so many of its depths are hidden."""
_HOLE = 2.5
"""Where the boundary has no piece within so many depths, a point of its own takes part."""
_GAP_WEIGHT = 0.1
"""Of such a point, against 1 of an opaque piece: behind a gap in the skin the boundary is a dent, which is bridged if
little speaks for it. On the ground they count in full, since nothing else is there."""
_NEIGHBOUR = 6
_LEAST_AGREEMENT = 0.2
"""Cosine between a piece's normal and the solid's below which the piece does not know the surface: needles, blobs."""


class Boundary:
    """The solid's boundary as a guide: which way is outwards near it. Pure; input units."""

    def __init__(self, mesh: Mesh) -> None:
        self.vertices, self.faces = mesh.vertices, mesh.faces
        self._tree = TriangleBVH(mesh.vertices, mesh.faces)
        normals = face_normals(mesh.vertices, mesh.faces)
        total = np.stack(
            [np.bincount(mesh.faces.ravel(), np.repeat(normals[:, i], 3), len(mesh.vertices)) for i in range(3)],
            axis=1,
        )
        self.normals = unit(total)

    def closest(self, points: Float[Array, "n 3"]) -> tuple[Float[Array, " n"], Float[Array, "n 3"]]:
        """Distance to the boundary, and the outward unit normal there, interpolated."""
        found, face, weights = self._tree.closest(points, threads=torch.get_num_threads())
        normals = np.einsum("nc,ncx->nx", weights, self.normals[self.faces[face]])
        return np.linalg.norm(points - found, axis=1), unit(normals)


@dataclass(frozen=True)
class Layer:
    """Points of the visible surface, one per cell and side; input units."""

    points: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    """Outward unit vectors."""
    weights: Float[Array, " n"]
    detail: Float[Array, " n"]
    """How far apart opaque centres are there."""
    centres: Float[Array, "k 3"]
    """Those of the opaque ones that are as near to the solid's boundary."""
    invented: float
    """Share of the solid's boundary that has no splats near it."""
    thinnest: float = np.inf
    """Thickness of what was given one."""


def visible_layer(
    surfels: Surfels, boundary: Boundary, solid: Solid, spacing: float, opaque: Float[Array, "k 3"]
) -> Layer:
    """Merge the pieces just below the boundary, cell by cell, apart where the boundary faces different ways.

    Args:
        surfels: all pieces.
        boundary: of the solid.
        solid: what the pieces are the skin of.
        spacing: width of a cell.
        opaque: centres of opaque splats.

    Raises:
        InputError: no piece lies near the boundary.
    """
    depth = solid.depth
    distance, outwards = boundary.closest(surfels.points)
    agreement = (surfels.normals * outwards).sum(axis=1)
    near = (distance <= _SLACK * depth) & (np.abs(agreement) >= _LEAST_AGREEMENT)
    if not near.any():
        raise InputError("no splat lies near the surface of the solid that they make; try another --base-mesh")
    seen, agreement, outwards = surfels.take(near), agreement[near], outwards[near]
    mass = seen.weights * seen.areas * agreement**2
    normals = seen.normals * np.sign(agreement)[:, None]
    cell = _cells(seen.points, outwards, spacing)
    total = np.bincount(cell, mass)
    points = _means(cell, mass, seen.points, total)
    layer_normals = unit(_means(cell, mass, normals, total))
    empty = KDTree(points).query(boundary.vertices)[0] > _HOLE * depth
    gap, gap_normals = boundary.vertices[empty], boundary.normals[empty]
    gap_weights = np.full(len(gap), _GAP_WEIGHT)
    if solid.ground is not None:
        gap_weights[solid.ground.height(gap) < depth] = 1.0
    points = np.concatenate([points, gap])
    return Layer(
        points=points,
        normals=np.concatenate([layer_normals, gap_normals]),
        weights=np.concatenate([np.minimum(total / spacing**2, 1.0), gap_weights]),
        detail=spacing_at(points, opaque),
        centres=opaque[boundary.closest(opaque)[0] <= _SLACK * depth],
        invented=float(empty.mean()),
    )


def spacing_at(points: Float[Array, "n 3"], centres: Float[Array, "k 3"]) -> Float[Array, " n"]:
    """Distance of each point from the sixth nearest centre, or the last where there are fewer."""
    found = KDTree(centres).query(
        points,
        k=[min(_NEIGHBOUR, len(centres))],  # pyright: ignore[reportArgumentType]  # takes ranks too
        workers=torch.get_num_threads(),
    )
    return np.asarray(found[0])[:, 0]


def _cells(points: Float[Array, "n 3"], outwards: Float[Array, "n 3"], spacing: float) -> Int[Array, " n"]:
    """A number from 0 on for every cell and each of the six ways that the boundary may face there."""
    axis = np.abs(outwards).argmax(axis=1)
    way = 2 * axis + (outwards[np.arange(len(axis)), axis] > 0)
    index = np.floor((points - points.min(axis=0)) / spacing).astype(np.int64)
    size = index.max(axis=0) + 1
    key = ((index[:, 0] * size[1] + index[:, 1]) * size[2] + index[:, 2]) * 6 + way
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def _means(
    cell: Int[Array, " n"], mass: Float[Array, " n"], rows: Float[Array, "n 3"], total: Float[Array, " c"]
) -> Float[Array, "c 3"]:
    middle = rows.mean(axis=0)
    sums = np.stack([np.bincount(cell, mass * (rows[:, i] - middle[i])) for i in range(3)], axis=1)
    return middle + sums / np.maximum(total, 1e-300)[:, None]


def unit(vectors: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
