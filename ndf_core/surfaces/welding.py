"""One vertex per place: equal (or nearly equal) vertices merged, and the faces that collapse by it dropped."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree


def weld(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], tolerance: float
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], list[str]]:
    """Merge vertices and say what became of it.

    Args:
        vertices: float64.
        faces: indices into them.
        tolerance: vertices at most this far apart become one, also along chains of them; 0 merges equal ones.

    Returns:
        The first vertex of each group, in order; faces with three different corners, one of each; notes.
    """
    # Adding 0 makes -0 and 0 the same.
    _, group = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    group = group.ravel()
    if tolerance > 0:
        group = _nearby(vertices, tolerance)
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    kept = np.sort(first)
    notes: list[str] = []
    if len(kept) < len(vertices):
        notes.append(f"{len(vertices) - len(kept):,} vertices merged with others at the same place")
    faces = rank[group.ravel()][faces]
    proper = (faces != faces[:, [1, 2, 0]]).all(axis=1)
    if not proper.all():
        notes.append(f"{int((~proper).sum()):,} degenerate triangles dropped")
        faces = faces[proper]
    # The same corners in the same turning sense: rotate the smallest to the front, then compare.
    turn = (np.arange(3) + faces.argmin(axis=1)[:, None]) % 3 if len(faces) else faces
    _, single = np.unique(np.take_along_axis(faces, turn, axis=1), axis=0, return_index=True)
    if len(single) < len(faces):
        notes.append(f"{len(faces) - len(single):,} duplicate triangles dropped")
        faces = faces[np.sort(single)]
    return vertices[kept], faces, notes


def _nearby(vertices: Float[Array, "v 3"], tolerance: float) -> Int[Array, " v"]:
    pairs = KDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    ones = np.ones(len(pairs), dtype=np.int8)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(vertices), len(vertices)))
    return np.asarray(connected_components(graph, directed=False)[1])
