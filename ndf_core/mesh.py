"""Triangle meshes as plain arrays: components, Euler characteristic, manifold checks, interpolation; numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int


@dataclass(frozen=True)
class Topology:
    """Counts that decide whether a mesh is usable; `genus` is the sum over components of a closed mesh."""

    vertices: int
    faces: int
    edges: int
    components: int
    euler_characteristic: int
    boundary_edges: int
    non_manifold_edges: int
    non_manifold_vertices: int
    inconsistent_edges: int
    """Edges whose two faces run through them in the same direction."""
    degenerate_faces: int
    """Faces that name a vertex twice."""
    unused_vertices: int

    @property
    def closed(self) -> bool:
        return self.boundary_edges == 0

    @property
    def manifold(self) -> bool:
        return (
            self.non_manifold_edges == 0
            and self.non_manifold_vertices == 0
            and self.inconsistent_edges == 0
            and self.degenerate_faces == 0
            and self.unused_vertices == 0
        )

    @property
    def genus(self) -> int | None:
        """Sum of the components' genera; None where the mesh is not closed and manifold."""
        if not (self.closed and self.manifold):
            return None
        return self.components - self.euler_characteristic // 2


def topology(faces: Int[Array, "f 3"], vertex_count: int) -> Topology:
    """Count everything in `Topology` from the faces alone, in O(f log f).

    A vertex is non-manifold when the faces around it form more than one fan. The Euler characteristic counts
    used vertices only.
    """
    faces = np.asarray(faces, dtype=np.int64)
    count = len(faces)
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    start = faces.ravel()
    end = faces[:, [1, 2, 0]].ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low * vertex_count + high
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    first = np.flatnonzero(np.r_[True, sorted_key[1:] != sorted_key[:-1]]) if count else np.zeros(0, np.int64)
    incident = np.diff(np.r_[first, len(sorted_key)])
    forward = (start < end)[order].astype(np.int64)
    runs_forward = np.add.reduceat(forward, first) if count else np.zeros(0, np.int64)
    pairs = first[incident == 2]
    left, right = order[pairs] // 3, order[pairs + 1] // 3
    used = int((np.bincount(start, minlength=1) > 0).sum()) if count else 0
    return Topology(
        vertices=used,
        faces=count,
        edges=len(first),
        components=_count_sets(count, left, right),
        euler_characteristic=used - len(first) + count,
        boundary_edges=int((incident == 1).sum()),
        non_manifold_edges=int((incident > 2).sum()),
        non_manifold_vertices=_non_manifold_vertices(faces, order, pairs, used),
        inconsistent_edges=int((runs_forward[incident == 2] != 1).sum()),
        degenerate_faces=int((~distinct).sum()),
        unused_vertices=vertex_count - used,
    )


def face_components(faces: Int[Array, "f 3"], vertex_count: int) -> Int[Array, " f"]:
    """Label of each face's edge-connected component, numbered from 0 in order of first appearance."""
    faces = np.asarray(faces, dtype=np.int64)
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    root = _union(len(faces), order[same] // 3, order[same + 1] // 3)
    _, first, label = np.unique(root, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first, kind="stable"), kind="stable")[label]


def face_normals(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3"]:
    """Area vectors: the normal of each face times twice its area, in the vertices' units squared."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def corner_angles(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3"]:
    """Angle of each face at each of its corners, in radians."""
    corners = vertices[faces]
    forward = np.roll(corners, -1, axis=1) - corners
    backward = np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(forward, backward), axis=2)
    return np.arctan2(sine, np.einsum("fck,fck->fc", forward, backward))


def vertex_directions(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], vectors: Float[Array, "f 3"]
) -> Float[Array, "v 3"]:
    """Unit means of the directions that faces have, weighed by their angles at the vertex; zero where they cancel."""
    weighed = corner_angles(vertices, faces)[:, :, None] * unit(vectors)[:, None]
    sums = [np.bincount(faces.ravel(), weighed[:, :, axis].ravel(), len(vertices)) for axis in range(3)]
    return unit(np.stack(sums, axis=1))


def vertex_normals(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "v 3"]:
    """Unit means of the faces' normals, weighed by their angles; zero where they cancel."""
    return vertex_directions(vertices, faces, face_normals(vertices, faces))


def unit(vectors: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Vectors over their lengths; zero where they are."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def signed_volume(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> float:
    """Enclosed volume; negative when a closed mesh is inside out. Taken about the centroid, for precision."""
    centred = vertices - vertices.mean(axis=0)
    a, b, c = (centred[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _union(count: int, left: Int[Array, " m"], right: Int[Array, " m"]) -> Int[Array, " n"]:
    """Smallest member of each element's connected set, by hooking and pointer jumping (O(log n) rounds)."""
    root = np.arange(count)
    while True:
        a, b = root[left], root[right]
        low, high = np.minimum(a, b), np.maximum(a, b)
        before = root.copy()
        np.minimum.at(root, high, low)
        while True:
            jumped = root[root]
            if np.array_equal(jumped, root):
                break
            root = jumped
        if np.array_equal(root, before):
            return root


def _count_sets(count: int, left: Int[Array, " m"], right: Int[Array, " m"]) -> int:
    # Each set is named after its smallest member.
    return int((_union(count, left, right) == np.arange(count)).sum())


def _non_manifold_vertices(
    faces: Int[Array, "f 3"], order: Int[Array, " h"], pairs: Int[Array, " p"], used: int
) -> int:
    """Corners joined across shared edges form one set per fan; a manifold vertex has one fan."""
    if not len(faces):
        return 0
    corner_vertex = faces.ravel()
    one, two = order[pairs], order[pairs + 1]
    left, right = [], []
    for mine in (one, (one // 3) * 3 + (one + 1) % 3):
        for other in (two, (two // 3) * 3 + (two + 1) % 3):
            match = corner_vertex[mine] == corner_vertex[other]
            left.append(mine[match])
            right.append(other[match])
    root = _union(len(corner_vertex), np.concatenate(left), np.concatenate(right))
    fans = np.flatnonzero(root == np.arange(len(root)))
    return int((np.bincount(corner_vertex[fans]) > 1).sum()) if used else 0


def interpolate(
    values: Float[Array, "v *k"], corners: Int[Array, "n 3"], weights: Float[Array, "n 3"]
) -> Float[Array, "n *k"]:
    """Values on vertices, linear on triangles, at points given by their triangles' corners and weights of these."""
    return np.einsum("nc...,nc->n...", values[corners], weights)
