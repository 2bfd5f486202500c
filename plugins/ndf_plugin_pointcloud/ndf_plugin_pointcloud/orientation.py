"""Outward normals for points that have none."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.winding import WindingTree
from ndf_core.surfaces.dilation import Offset
from ndf_plugin_pointcloud.areas import disc_areas
from ndf_plugin_pointcloud.local_planes import point_normals

_LIFT = 2.0
"""Above and below a point, in radii of its disc."""
_LEAST = 1e-6
"""Added to the weights of edges, since the sparse graph forgets edges of weight 0."""


def oriented_normals(
    points: Float[Array, "n 3"], neighbours: int, outwards: Float[Array, "n 3"] | None, threads: int = 1
) -> Float[Array, "n 3"]:
    """Unit normals of planes through each point's neighbours, turned outwards.

    Signs spread along the tree of neighbours that joins those with the most similar planes first. The sign of each
    connected part is the one that more of its points have from `outwards`, or, without that, the one that encloses
    a positive volume.

    Args:
        points: distinct.
        neighbours: points that a plane is fitted to.
        outwards: a vector at each point that is on the outer side, where it is known.
        threads: for the search.

    Reference: Hoppe, DeRose, Duchamp, McDonald and Stuetzle, Surface reconstruction from unorganized points, 1992.
    """
    normals, index = point_normals(points, neighbours, threads)
    rows, columns = np.repeat(np.arange(len(points)), index.shape[1] - 1), index[:, 1:].ravel()
    likeness = np.einsum("nc,nc->n", normals[rows], normals[columns])
    graph = coo_array((1 - np.abs(likeness) + _LEAST, (rows, columns)), shape=(len(points), len(points)))
    tree = minimum_spanning_tree(graph.tocsr())
    label = np.asarray(connected_components(tree, directed=False)[1])
    signs = _spread(tree, label, normals)
    if outwards is None:
        sums = np.stack([np.bincount(label, points[:, k]) for k in range(3)], axis=1)
        outwards = points - (sums / np.bincount(label)[:, None])[label]
    vote = np.sign(signs * np.einsum("nc,nc->n", normals, outwards))
    return (signs * np.where(np.bincount(label, vote)[label] < 0, -1.0, 1.0))[:, None] * normals


def enclosing_share(points: Float[Array, "n 3"], normals: Float[Array, "n 3"], threads: int = 1) -> float:
    """Share of the points that the others close up with: beside them the mean of the winding numbers in front and
    behind is more than 0.4. It is 1/2 where they close up, 0.35 in the middle of half of a sphere, 0 on a flat sheet.

    Args:
        points: distinct.
        normals: unit, all outwards or all inwards.
        threads: for the search and the field.
    """
    areas = disc_areas(KDTree(points), normals, threads)
    radii = np.sqrt(areas / np.pi)
    tree, lift = WindingTree.of_points(points, areas[:, None] * normals, radii), _LIFT * radii[:, None] * normals
    both = tree.values(points + lift, threads) + tree.values(points - lift, threads)
    return float((np.abs(both) / 2 > 0.4).mean())


def outward_vectors(points: Float[Array, "n 3"], offset: Offset, threads: int = 1) -> Float[Array, "n 3"]:
    """From each point to the closest point of the dilation's outer side."""
    return TriangleBVH(offset.vertices, offset.faces).closest(points, threads)[0] - points


def _spread(tree: object, label: Int[Array, " n"], normals: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """A sign for each normal that makes neighbours in the tree agree."""
    signs = np.ones(len(normals))
    for root in np.unique(label, return_index=True)[1]:
        order, before = breadth_first_order(tree, root, directed=False)
        order = np.asarray(order)[1:]
        flips = np.einsum("nc,nc->n", normals[order], normals[before[order]]) < 0
        for point, parent, flip in zip(order.tolist(), before[order].tolist(), flips.tolist(), strict=True):
            signs[point] = -signs[parent] if flip else signs[parent]
    return signs
