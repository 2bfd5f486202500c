"""Short loops on a closed surface that do not bound a piece of it: one around every thin handle or narrow tunnel.

A spanning tree of the vertices and one of the faces that crosses none of its edges leave 2 * genus edges over. Each
of these closes a loop of faces, and a loop of edges separates the surface exactly if it crosses each loop of faces
an even number of times. So every edge gets a *signature*, the set of loops of faces that cross it, as the bits of an
integer; a loop of edges is wanted if the exclusive or of its signatures is not zero.

Reference:
    Erickson and Whittlesey, Greedy optimal homotopy and homology generators, 2005.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree


@dataclass(frozen=True)
class Loop:
    """A simple closed path of edges."""

    vertices: tuple[int, ...]
    length: float
    signature: int


class _Graph:
    """Edges of a closed manifold mesh with their lengths, and the neighbours of each vertex."""

    def __init__(self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> None:
        start, end = faces.reshape(-1).astype(np.int64), faces[:, [1, 2, 0]].reshape(-1).astype(np.int64)
        key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        self.count = len(vertices)
        self.face_count = len(faces)
        self.ends = np.stack(np.divmod(key[order][::2], self.count), axis=1)
        self.sides = order.reshape(-1, 2) // 3
        self.lengths = np.linalg.norm(vertices[self.ends[:, 0]] - vertices[self.ends[:, 1]], axis=1)

    def leftover(self) -> tuple[Int[Array, " k"], csr_array]:
        """Edges in neither tree, and the tree of faces."""
        edges = len(self.ends)
        tree = _tree_edges(self.ends, self.lengths, self.count)
        free = np.setdiff1d(np.arange(edges), tree, assume_unique=True)
        # Crossing short edges last keeps the loops of faces near the handles.
        crossing = _tree_edges(self.sides[free], -self.lengths[free], self.face_count)
        cotree = self.sides[free[crossing]]
        graph = _graph(cotree, free[crossing] + 1.0, self.face_count)
        return np.delete(free, crossing), graph


def _graph(ends: Int[Array, "e 2"], weights: Float[Array, " e"], count: int) -> csr_array:
    rows, columns = np.concatenate([ends[:, 0], ends[:, 1]]), np.concatenate([ends[:, 1], ends[:, 0]])
    return csr_array(coo_array((np.concatenate([weights, weights]), (rows, columns)), shape=(count, count)))


def _tree_edges(ends: Int[Array, "e 2"], weights: Float[Array, " e"], count: int) -> Int[Array, " t"]:
    """Rows of a minimum spanning forest. Ranks replace the weights, so that ties and signs do not matter."""
    rank = np.empty(len(weights))
    rank[np.argsort(weights, kind="stable")] = np.arange(1, len(weights) + 1)
    low, high = ends.min(axis=1), ends.max(axis=1)
    # Of parallel edges (two faces with two common edges) only one can be in the tree.
    _, first = np.unique(low * count + high, return_index=True)
    graph = csr_array(coo_array((rank[first], (low[first], high[first])), shape=(count, count)))
    chosen = np.asarray(minimum_spanning_tree(graph).data).astype(np.int64)
    return np.argsort(weights, kind="stable")[chosen - 1]


def short_loops(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], max_length: float) -> list[Loop]:
    """Disjoint loops of at most `max_length` that together separate nothing, the shortest first.

    Cutting the surface along all of them takes away one handle each. Where two loops cross (around a handle and
    through it), the shorter one is found.

    Args:
        vertices: Of a closed manifold mesh.
        max_length: In the units of the vertices.
    """
    graph = _Graph(vertices, faces)
    signatures = _signatures(graph)
    if not signatures:
        return []
    neighbours = _neighbours(graph)
    loops: list[Loop] = []
    for seed in np.unique(graph.ends[sorted(signatures)]):
        loops += _loop_through(int(seed), neighbours, graph, signatures, max_length)
    return _independent(sorted(loops, key=lambda loop: (loop.length, loop.vertices)))


def _signatures(graph: _Graph) -> dict[int, int]:
    """Edges that a loop of faces crosses, with the set of these loops as bits."""
    leftover, cotree = graph.leftover()
    crossing: dict[int, int] = {}
    if not len(leftover):
        return crossing
    parent, parent_edge, depth = _rooted(cotree, graph.face_count)
    for bit, edge in enumerate(leftover):
        crossed = [int(edge)]
        one, other = (int(side) for side in graph.sides[edge])
        while one != other:
            if depth[one] < depth[other]:
                one, other = other, one
            crossed.append(int(parent_edge[one]))
            one = int(parent[one])
        for index in crossed:
            crossing[index] = crossing.get(index, 0) ^ 1 << bit
    return {index: bits for index, bits in crossing.items() if bits}


def _rooted(tree: csr_array, count: int) -> tuple[Int[Array, " f"], Int[Array, " f"], Int[Array, " f"]]:
    """Parent of each node of a forest, the edge to it (stored as weight - 1) and the depth."""
    _, label = connected_components(tree, directed=False)
    parent, depth = np.full(count, -1), np.zeros(count, dtype=np.int64)
    for root in np.unique(label, return_index=True)[1]:
        order, before = breadth_first_order(tree, root, directed=False)
        parent[order[1:]] = before[order[1:]]
        for node in order[1:]:
            depth[node] = depth[parent[node]] + 1
    edge = np.full(count, -1)
    child = np.flatnonzero(parent >= 0)
    edge[child] = np.asarray(tree[child, parent[child]]).reshape(-1).astype(np.int64) - 1
    return parent, edge, depth


def _neighbours(graph: _Graph) -> csr_array:
    return _graph(graph.ends, np.arange(1.0, len(graph.ends) + 1), graph.count)


def _loop_through(
    seed: int, neighbours: csr_array, graph: _Graph, signatures: dict[int, int], max_length: float
) -> list[Loop]:
    """The shortest wanted loop that a tree of shortest paths from `seed` closes, if it is short enough."""
    start, column, edge_of = neighbours.indptr, neighbours.indices, neighbours.data
    distance, parent, bits = {seed: 0.0}, {seed: -1}, {seed: 0}
    queue, done = [(0.0, seed)], set[int]()
    best: tuple[float, int, int, int] | None = None
    while queue:
        here, v = heappop(queue)
        if v in done:
            continue
        done.add(v)
        if 2 * here > max_length:
            break
        for at in range(start[v], start[v + 1]):
            w, edge = int(column[at]), int(edge_of[at]) - 1
            far = here + graph.lengths[edge]
            signature = bits[v] ^ signatures.get(edge, 0)
            if w in done:
                total = far + distance[w]
                if signature != bits[w] and total <= max_length and (best is None or total < best[0]):
                    best = (float(total), v, w, signature ^ bits[w])
            elif far < distance.get(w, np.inf):
                distance[w], parent[w], bits[w] = far, v, signature
                heappush(queue, (far, w))
    if best is None:
        return []
    one, other = _path(best[1], parent), _path(best[2], parent)
    while len(one) > 1 and len(other) > 1 and one[-2] == other[-2]:
        one.pop()
        other.pop()
    return [Loop((*one, *reversed(other[:-1])), best[0], best[3])]


def _path(v: int, parent: dict[int, int]) -> list[int]:
    path = [v]
    while parent[v] >= 0:
        v = parent[v]
        path.append(v)
    return path


def _independent(loops: list[Loop]) -> list[Loop]:
    """A maximal choice, greedily, of loops without a common vertex whose signatures are independent over GF(2)."""
    basis: dict[int, int] = {}
    used: set[int] = set()
    chosen: list[Loop] = []
    for loop in loops:
        rest = loop.signature
        while rest and rest.bit_length() in basis:
            rest ^= basis[rest.bit_length()]
        if not rest or used.intersection(loop.vertices):
            continue
        basis[rest.bit_length()] = rest
        used.update(loop.vertices)
        chosen.append(loop)
    return chosen
