"""A closed surface around points without normals: the offset level set of the distance to them (Fig. dilation).

The offset of points on a closed surface is a shell with a hollow inside. Left out, the shell's inner side gives a
solid; kept, it gives a wall about twice the radius thick. Points of an open sheet have no hollow inside: their offset
is a thin closed shell either way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy import ndimage
from scipy.spatial import KDTree

from ndf_core.base_mesh.checks import component_volumes, winding_number
from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.crumbs import compact
from ndf_core.base_mesh.lattice import ScalarField
from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, Remark
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.winding import WindingTree
from ndf_core.mesh import face_components

CELLS_PER_RADIUS = 2.0
"""The grid resolves the offset this well; finer shows the balls that it is made of."""
FINEST, COARSEST = 256, 48
"""Cells along the longest side of the grid, whatever the radius."""
_REACH = 16
"""Distances are looked up to the radius and so many cells: farther ones are never needed, and dear."""
_MOST_CELLS = 40_000_000
"""Of the grid that is searched for a hollow inside."""
_HOLLOW = 0.1
"""A hollow of less than this share of the shell's volume is a pocket of an open sheet."""
_CLOSING = 2.0
"""The offset by so many widths of cells covers about what the cells do that are next to a point."""

Interior = Literal["fill", "keep"]


@dataclass(frozen=True)
class Offset:
    """The level set of the distance to points at a radius, as closed manifold triangles in input units."""

    vertices: Float[Array, "v 3"]
    faces: Int[Array, "f 3"]
    """Outwards."""
    remarks: tuple[Remark, ...]


def offset_surface(points: Float[Array, "n 3"], radius: float, interior: Interior = "fill") -> Offset:
    """Points dilated by `radius`.

    Args:
        points: input units, finite.
        radius: input units. Gaps between points up to twice as wide are closed.
        interior: "fill" keeps the outer sides alone, "keep" the inner ones too.

    Raises:
        BaseMeshError: no manifold mesh can be made.
    """
    # Within the outermost balls, and a little room so that none touches the bounds.
    bounds = np.stack([points.min(axis=0) - 1.5 * radius, points.max(axis=0) + 1.5 * radius])
    side = float((bounds[1] - bounds[0]).max())
    resolution = int(np.clip(CELLS_PER_RADIUS * side / radius, COARSEST, FINEST))
    field = distance_beyond(points, radius, radius + _REACH * side / resolution)
    policy = LevelSetPolicy(resolution=resolution, max_resolution=resolution)
    vertices, faces, remarks = LevelSetExtractor(field, bounds, lipschitz=1.0, policy=policy).dense()
    label, volumes = face_components(faces, len(vertices)), component_volumes(vertices, faces)
    outer = _outer(vertices, faces, label, volumes)
    # What the level set loses between two resolutions of a grid is no news: its details are the balls.
    told = [remark for remark in remarks if remark.kind != "topology_not_settled"]
    if interior == "fill" and not outer.all():
        vertices, faces = compact(vertices, faces[outer[label]])
        message = f"{int((~outer).sum()):,} surfaces inside of others left out: the interior is filled"
        told.append(Remark("filled_interior", message, count=int((~outer).sum())))
    return Offset(vertices, faces, tuple(told))


def eroded(offset: Offset, depth: float, threads: int = 1) -> Offset:
    """The solid inside of an offset surface, less what is nearer to it than `depth`.

    Dilated and then eroded by about as much, points keep what closed them, and lie nearly on the surface: the
    morphological closing of the points.

    Args:
        offset: a filled one.
        depth: input units, less than its radius, so that all points stay inside.
        threads: for the distances.

    Raises:
        BaseMeshError: nothing is left, or no manifold mesh can be made.

    Reference: J. Serra, Image Analysis and Mathematical Morphology, 1982.
    """
    triangles = TriangleBVH(offset.vertices, offset.faces)
    winding = WindingTree.of_triangles(offset.vertices, offset.faces)

    def unsigned(queries: Float[Array, "n 3"]) -> Float[Array, " n"]:
        return np.linalg.norm(triangles.closest(queries, threads)[0] - queries, axis=1)

    def field(queries: Float[Array, "n 3"]) -> Float[Array, " n"]:
        return depth - np.where(winding.values(queries, threads) > 0.5, 1.0, -1.0) * unsigned(queries)

    bounds = np.stack([offset.vertices.min(axis=0), offset.vertices.max(axis=0)])
    resolution = int(np.clip(CELLS_PER_RADIUS * float(np.ptp(bounds, axis=0).max()) / depth, COARSEST, FINEST))
    policy = LevelSetPolicy(resolution=resolution, max_resolution=resolution)
    vertices, faces, remarks = LevelSetExtractor(field, bounds, lipschitz=1.0, policy=policy).dense()
    told = [remark for remark in remarks if remark.kind != "topology_not_settled"]
    return Offset(vertices, faces, (*offset.remarks, *told))


def distance_beyond(points: Float[Array, "n 3"], radius: float, limit: float) -> ScalarField:
    """The distance to the nearest of `points` minus `radius`; infinite where that distance exceeds `limit`."""
    tree = KDTree(points)

    def field(queries: Float[Array, "m 3"]) -> Float[Array, " m"]:
        return tree.query(queries, distance_upper_bound=limit)[0] - radius

    return field


def _outer(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], label: Int[Array, " f"], volumes: Float[Array, " c"]
) -> Bool[Array, " c"]:
    """Components that no other one encloses: neither the walls of hollows nor what floats in them."""
    outer = volumes > 0
    _, first = np.unique(label, return_index=True)
    for index in np.argsort(volumes):  # the small ones first: they lie in the large ones
        others = outer.copy()
        others[index] = False
        if outer[index] and others.any():
            rows = others[label]
            outer[index] = winding_number(vertices[faces[first[index], 0]], vertices, faces[rows]) < 0.5
    return outer


class DilationExtractor(BaseMeshExtractor):
    """Base mesh of points without normals: their offset, coarsened."""

    def __init__(self, offset: Offset) -> None:
        self._offset = offset

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh; `seed` is not used, nothing here is random."""
        del seed
        offset = self._offset
        return coarsen(offset.vertices, offset.faces, max_faces, remarks=offset.remarks)


def sampling_spacing(points: Float[Array, "n 3"], neighbours: int = 6) -> Float[Array, " n"]:
    """Distance of each point to its `neighbours`-th nearest other one (fewer where there are fewer points)."""
    count = min(neighbours, len(points) - 1)
    return np.asarray(KDTree(points).query(points, k=count + 1)[0])[:, -1]


def closing_radius(points: Float[Array, "n 3"], spacing: float, widest: float) -> float | None:
    """The smallest radius, up to `widest`, at which the offset of the points closes around an inside; None if none
    does: the points are an open sheet, or their gaps are wider.

    Found by flood fill from outside through the cells of a grid that are not next to a point. Radii grow by quarters.

    Args:
        points: input units.
        spacing: a typical distance between neighbours, positive.
        widest: the largest radius to try.
    """
    extent, radius = np.ptp(points, axis=0), spacing
    while radius <= widest:
        cell = radius / _CLOSING
        if (extent / cell + 5).prod() <= _MOST_CELLS and _encloses(points, cell):
            return radius
        radius *= 1.25
    return None


def _encloses(points: Float[Array, "n 3"], cell: float) -> bool:
    """Whether the cells at and next to points keep a sizeable hollow from the outside."""
    index = np.unique(np.floor((points - points.min(axis=0)) / cell).astype(np.int64), axis=0) + 2
    marked = np.zeros(index.max(axis=0) + 3, dtype=bool)
    for offset in np.ndindex(3, 3, 3):
        marked[tuple((index + offset - 1).T)] = True
    label = np.asarray(ndimage.label(~marked)[0])  # pyright: ignore[reportIndexIssue]  # a pair
    hollow = label.size - int(marked.sum()) - int((label == label[0, 0, 0]).sum())
    return hollow > _HOLLOW * int(marked.sum())
