"""Edges of a triangle mesh, its orientation, and vertices where parts of it touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ndf_core.errors import InputError


@dataclass(frozen=True)
class Edges:
    """Undirected edges with the half-edges on them. Half-edge 3 f + i runs from corner i of face f to the next."""

    ends: Int[Array, "e 2"]
    """Vertices, the smaller first."""
    uses: Int[Array, " e"]
    """Number of triangles on each."""
    first: Int[Array, " e"]
    """Position of the edge's half-edges in `order`."""
    order: Int[Array, " h"]
    """Half-edges, sorted by edge."""

    @staticmethod
    def of(faces: Int[Array, "f 3"], vertex_count: int) -> Edges:
        start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
        key = np.minimum(start, end).astype(np.int64) * vertex_count + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        keys, first, uses = np.unique(key[order], return_index=True, return_counts=True)
        return Edges(np.stack([keys // vertex_count, keys % vertex_count], axis=1), uses, first, order)

    @property
    def pairs(self) -> tuple[Int[Array, " e"], Int[Array, " e"]]:
        """The two half-edges of every edge; each must have two."""
        return self.order[self.first], self.order[self.first + 1]


def orient(faces: Int[Array, "f 3"], edges: Edges, origin: str) -> tuple[Int[Array, "f 3"], int]:
    """Turn as few faces of each component as makes neighbours agree; also how many.

    A double cover decides: two nodes per face, as it is and turned; neighbours that agree join like with like, others
    crosswise. An orientable component falls into two halves, one for each orientation.

    Raises:
        InputError: a component is not orientable.
    """
    one, two = edges.pairs
    same_direction = faces.ravel()[one] == faces.ravel()[two]
    if not same_direction.any():
        return faces, 0
    count = len(faces)
    left, right = one // 3, two // 3
    across = np.where(same_direction, count, 0)
    rows = np.concatenate([left, left + count])
    columns = np.concatenate([right + across, right + count - across])
    _, half = _connected(2 * count, rows, columns)
    as_is, turned = half[:count], half[count:]
    if (as_is == turned).any():
        raise InputError(f"{origin}: the surface is one-sided (not orientable), so it has no inside")
    # Both halves hold every face of the component once; keep the one with more faces as they are.
    kept = np.bincount(as_is, minlength=2 * count)
    turn = kept[turned] > kept[as_is]
    # Two equal halves: the one that came first.
    turn |= (kept[turned] == kept[as_is]) & (turned < as_is)
    return np.where(turn[:, None], faces[:, ::-1], faces), int(turn.sum())


def split_vertices(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]
) -> tuple[Float[Array, "w 3"], Int[Array, "f 3"], int]:
    """Give each fan of triangles around a vertex a vertex of its own; also how many vertices were split.

    The mesh must be closed and oriented. New vertices come last.
    """
    corners = faces.ravel()
    one, two = Edges.of(faces, len(vertices)).pairs
    # Half-edge h starts at corner h; its opposite runs the other way, so the corner after it is at the same vertex.
    following = 3 * (two // 3) + (two + 1) % 3
    previous = 3 * (one // 3) + (one + 1) % 3
    fans, fan = _connected(len(corners), np.concatenate([one, previous]), np.concatenate([following, two]))
    if fans == len(vertices):
        return vertices, faces, 0
    owner = np.empty(fans, dtype=np.int64)
    owner[fan] = corners
    _, first = np.unique(owner, return_index=True)
    index = np.full(fans, -1, dtype=np.int64)
    index[first] = owner[first]
    extra = np.flatnonzero(index < 0)
    index[extra] = len(vertices) + np.arange(len(extra))
    split = len(np.unique(owner[extra]))
    return np.concatenate([vertices, vertices[owner[extra]]]), index[fan].reshape(-1, 3), split


def _connected(count: int, rows: Int[Array, " m"], columns: Int[Array, " m"]) -> tuple[int, Int[Array, " n"]]:
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    found, label = connected_components(graph, directed=False)
    return int(found), np.asarray(label)
