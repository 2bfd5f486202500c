"""What a client does with an asset that has fracture modes: break its surface where it is hit. No torch."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse.csgraph import connected_components

from ndf_core.asset.asset import Asset
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals
from ndf_core.processing.operators import Operators

FIELD = "pieces"
_WIDTH = 0.12
"""How far an impact spreads, as a share of the longest side."""
_CRUMB = 3e-3
"""Least share of the area that a part keeps for itself."""
_NEAREST = 0.05
"""Cuts keep this share of an edge away from its ends."""


class Shatter:
    """The surface, cut along the pieces of all modes, and the factor that spreads impacts. Input units."""

    def __init__(self, asset: Asset, edge_length: float | None = None, threads: int = 1) -> None:
        motions = asset.content.provenance["fracture"]
        mesh = asset.extract(edge_length, threads, measure_edges=False)
        scores = asset.evaluate(mesh.base_faces, mesh.barycentric, FIELD, threads).astype(np.float64)
        counts = [len(motion) for motion in motions]
        ends = np.cumsum(counts)
        vertices, faces = mesh.vertices, mesh.faces
        for start, end in zip(ends - counts, ends, strict=True):
            for piece in range(start, end):
                rest = np.delete(scores[:, start:end], piece - start, axis=1).max(axis=1)
                vertices, faces, scores = cut(vertices, faces, scores, scores[:, piece] - rest)
        inside = scores[faces].mean(axis=1)
        self.labels = np.stack([inside[:, s:e].argmax(axis=1) for s, e in zip(ends - counts, ends, strict=True)])
        """(modes, faces): the piece that each face is in."""
        self._vertices, self._faces, self._motions = vertices, faces, [np.array(motion) for motion in motions]
        self._tree = TriangleBVH(mesh.vertices, mesh.faces)
        self._mesh_faces = mesh.faces
        operators = Operators.of(mesh)
        self._spread = operators.heat_step((_WIDTH * asset.longest_side) ** 2)
        self._weights = self._impulses(scores[: len(mesh.vertices)], operators.lumped_mass, ends, counts)
        self._join_atoms()

    def strengths(self, point: Float[Array, "3"], direction: Float[Array, "3"]) -> Float[Array, " m"]:
        """How much of an impact goes into each mode: the product of the mode with the spread impulse."""
        _, face, weights = self._tree.closest(point[None])
        right = np.zeros(self._weights.shape[1])
        right[self._mesh_faces[face[0]]] = weights[0]
        received = self._weights @ self._spread.solve(right)
        received = received.reshape(-1, 3) @ (direction / np.linalg.norm(direction))
        return np.abs(np.add.reduceat(received, self._starts))

    def hit(
        self, point: Float[Array, "3"], direction: Float[Array, "3"], toughness: float = 0.5
    ) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"], Int[Array, " f"]]:
        """The fractured mesh: closed pieces, each with vertices of its own, and the piece of each face.

        Args:
            point: where the surface is hit.
            direction: of the impact.
            toughness: modes break that take at least this share of what the strongest takes.
        """
        strengths = self.strengths(point, direction)
        broken = np.flatnonzero(strengths >= toughness * strengths.max())
        return self.pieces(broken)

    def pieces(self, broken: Int[Array, " k"]) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"], Int[Array, " f"]]:
        """The mesh broken by these modes at once."""
        key = self._atom_labels[broken]
        same = (key[:, self._sides[0]] == key[:, self._sides[1]]).all(axis=0)
        count = len(self._atom_labels[0])
        graph = sp.coo_array((np.ones(int(same.sum())), self._sides[:, same]), shape=(count, count))
        piece_of_atom = connected_components(graph, directed=False)[1]
        # Cracks: borders between atoms of different pieces, once for each side.
        sides = piece_of_atom[self._border_sides]
        cracked = sides[0] != sides[1]
        a, b = self._border[:, cracked]
        piece = sides[0, cracked]
        return self._closed(piece_of_atom[self._atoms], a, b, piece)

    def _closed(
        self, piece: Int[Array, " f"], a: Int[Array, " e"], b: Int[Array, " e"], edge_piece: Int[Array, " e"]
    ) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"], Int[Array, " f"]]:
        """Vertices on cracks once for each piece, and a fan over each loop of each piece's cracks."""
        faces, count = self._faces.copy(), len(self._vertices)
        ends = np.concatenate([edge_piece * count + a, edge_piece * count + b])
        nodes, index = np.unique(ends, return_inverse=True)
        on_crack = np.zeros(count, dtype=bool)
        on_crack[a] = True
        touched = self._beside[on_crack[self._faces[self._beside]].any(axis=1)]
        part = faces[touched]
        place = np.searchsorted(nodes, piece[touched, None] * count + part)
        place = np.minimum(place, len(nodes) - 1)
        split = nodes[place] == piece[touched, None] * count + part
        faces[touched] = np.where(split, count + place, part)
        if not len(nodes):
            return self._vertices, faces, piece
        start, end = index[: len(a)], index[len(a) :]
        links = sp.coo_array((np.ones(len(a)), (start, end)), shape=(len(nodes), len(nodes)))
        loop = connected_components(links, directed=False)[1]
        copies = self._vertices[nodes % count]
        # Pieces that meet in one net of cracks reach for the same point, so that together they fill the whole.
        places, place = np.unique(nodes % count, return_inverse=True)
        links = sp.coo_array((np.ones(len(a)), (place[start], place[end])), shape=(len(places),) * 2)
        net = connected_components(links, directed=False)[1]
        sizes, reached = np.bincount(net), np.zeros(loop.max() + 1, dtype=np.int64)
        reached[loop] = net[place]
        middles = np.stack([np.bincount(net, self._vertices[places, axis]) / sizes for axis in range(3)], axis=1)
        middles = middles[reached]
        fans = np.stack([count + end, count + start, count + len(nodes) + loop[start]], axis=1)
        return (
            np.concatenate([self._vertices, copies, middles]),
            np.concatenate([faces, fans.astype(np.int32)]),
            np.concatenate([piece, edge_piece]),
        )

    def _impulses(
        self, scores: Float[Array, "v c"], mass: Float[Array, " v"], ends: Int[Array, " m"], counts: list[int]
    ) -> Float[Array, "c3 v"]:
        """Rows (column, axis) that take a spread impulse to what each piece of each mode receives along each axis."""
        self._starts = ends - counts
        rows = list[Array]()
        for start, end, motion in zip(self._starts, ends, self._motions, strict=True):
            own = np.eye(end - start)[scores[:, start:end].argmax(axis=1)] * mass[:, None]
            rows.append(np.einsum("vp,pa->pav", own, motion).reshape(-1, len(mass)))
        return np.concatenate(rows)

    def _join_atoms(self) -> None:
        """Atoms: what no mode cuts. Impacts only have to decide which of them stay together."""
        count = len(self._faces)
        starts = self._faces.ravel().astype(np.int64)
        stops = self._faces[:, [1, 2, 0]].ravel().astype(np.int64)
        owner = np.repeat(np.arange(count), 3)
        key = starts * len(self._vertices) + stops
        order = np.argsort(key)
        twin = order[np.searchsorted(key[order], stops * len(self._vertices) + starts)]
        across = owner[twin]
        same = (self.labels[:, owner] == self.labels[:, across]).all(axis=0)
        graph = sp.coo_array((np.ones(int(same.sum())), (owner[same], across[same])), shape=(count, count))
        self._atoms = connected_components(graph, directed=False)[1]
        self._drop_crumbs(owner, across)
        self._atom_labels = np.zeros((len(self.labels), self._atoms.max() + 1), dtype=np.int64)
        self._atom_labels[:, self._atoms] = self.labels
        border = self._atoms[owner] != self._atoms[across]
        self._border = np.stack([starts[border], stops[border]])
        self._border_sides = np.stack([self._atoms[owner[border]], self._atoms[across[border]]])
        self._sides = np.unique(self._border_sides, axis=1)
        on_border = np.zeros(len(self._vertices), dtype=bool)
        on_border[starts[border]] = True
        self._beside = np.flatnonzero(on_border[self._faces].any(axis=1))
        """Faces that have a corner on a border: no other can come to lie on a crack."""

    def _drop_crumbs(self, owner: Int[Array, " h"], across: Int[Array, " h"]) -> None:
        """Atoms of almost no area, slivers between almost equal cracks, go over to a neighbour."""
        sizes = np.bincount(self._atoms, np.linalg.norm(face_normals(self._vertices, self._faces), axis=1))
        borders = np.zeros((len(sizes), len(sizes)))
        np.add.at(borders, (self._atoms[owner], self._atoms[across]), 1.0)
        np.fill_diagonal(borders, 0.0)
        labels = np.zeros((len(self.labels), len(sizes)), dtype=self.labels.dtype)
        labels[:, self._atoms] = self.labels
        least, becomes = _CRUMB * sizes.sum(), np.arange(len(sizes))
        while sizes.min() < least and np.isfinite(sizes).sum() > 1:
            crumb = int(sizes.argmin())
            neighbour = int(borders[crumb].argmax())
            becomes[becomes == crumb] = neighbour
            sizes[neighbour] += sizes[crumb]
            sizes[crumb] = np.inf
            borders[neighbour] += borders[crumb]
            borders[:, neighbour] += borders[:, crumb]
            borders[crumb], borders[:, crumb], borders[neighbour, neighbour] = 0.0, 0.0, 0.0
        self.labels = labels[:, becomes[self._atoms]]
        self._atoms = np.unique(becomes, return_inverse=True)[1][self._atoms]


def cut(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], values: Float[Array, "v c"], level: Float[Array, " v"]
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], Float[Array, "w c"]]:
    """Split triangles where `level`, linear in them, changes its sign; values are interpolated."""
    inside = level > 0
    corners = inside[faces]
    crossed = corners.any(axis=1) & ~corners.all(axis=1)
    part = faces[crossed]
    # The corner that is alone on its side comes first.
    alone = np.where(corners[crossed].sum(axis=1) == 1, True, False)
    first = (corners[crossed] == alone[:, None]).argmax(axis=1)
    a, b, c = np.take_along_axis(part, (first[:, None] + np.arange(3)) % 3, axis=1).T.astype(np.int64)
    count = len(vertices)
    edges = np.stack([np.concatenate([a, a]), np.concatenate([b, c])])
    low, high = edges.min(axis=0), edges.max(axis=0)
    keys, which = np.unique(low * count + high, return_inverse=True)
    low, high = keys // count, keys % count
    share = np.clip(level[low] / (level[low] - level[high]), _NEAREST, 1 - _NEAREST)[:, None]
    ab, ac = count + which[: len(a)], count + which[len(a) :]
    pieces = [np.stack(three, axis=1) for three in ((a, ab, ac), (ab, b, c), (ab, c, ac))]
    return (
        np.concatenate([vertices, (1 - share) * vertices[low] + share * vertices[high]]),
        np.concatenate([faces[~crossed], *pieces]).astype(np.int32),
        np.concatenate([values, (1 - share) * values[low] + share * values[high]]),
    )


def volumes(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], piece: Int[Array, " f"]) -> Float[Array, " k"]:
    """Enclosed by each piece."""
    return np.bincount(piece, (vertices[faces[:, 0]] * face_normals(vertices, faces)).sum(axis=1) / 6)
