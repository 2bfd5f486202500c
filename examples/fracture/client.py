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
        impulses = self._impulses(scores[: len(mesh.vertices)], operators.lumped_mass, ends, counts)
        # The heat step is symmetric: spread what listens once, instead of every impact.
        self._received = operators.heat_step((_WIDTH * asset.longest_side) ** 2).solve(impulses)
        self._join_atoms()

    def strengths(self, point: Float[Array, "3"], direction: Float[Array, "3"]) -> Float[Array, " m"]:
        """How much of an impact goes into each mode: the product of the mode with the spread impulse."""
        _, face, weights = self._tree.closest(point[None])
        received = weights[0] @ self._received[self._mesh_faces[face[0]]]
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
        piece_of_atom = _joined(self._sides[0, same], self._sides[1, same], len(self._atom_labels[0]))
        # Cracks: borders between atoms of different pieces, once for each side.
        sides = piece_of_atom[self._border_sides]
        cracked = sides[0] != sides[1]
        starts, ends = self._border
        return self._closed(piece_of_atom, starts[cracked], ends[cracked], sides[0, cracked])

    def _closed(
        self,
        piece_of_atom: Int[Array, " t"],
        starts: Int[Array, " e"],
        ends: Int[Array, " e"],
        edge_piece: Int[Array, " e"],
    ) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"], Int[Array, " f"]]:
        """Vertices on cracks once for each piece, and a fan over each loop of each piece's cracks.

        `starts` and `ends` are the cracks' edges, seen from `edge_piece`, as numbers of border vertices.
        """
        faces, count, border = self._faces.copy(), len(self._vertices), len(self._border_vertices)
        piece = piece_of_atom[self._atoms]
        if not len(starts):
            return self._vertices, faces, piece
        # A table of (piece, border vertex) takes no sorting: the copy's number there, or -1.
        table = np.full((piece_of_atom.max() + 1) * border, -1, dtype=np.int32)
        starts_at, ends_at = edge_piece * border + starts, edge_piece * border + ends
        table[starts_at] = table[ends_at] = 0
        nodes = np.flatnonzero(table == 0)
        table[nodes] = np.arange(len(nodes))
        copy = table[piece_of_atom[self._corner_atom] * border + self._corner_vertex]
        moved = copy >= 0
        faces.ravel()[self._corner[moved]] = count + copy[moved]
        start, end = table[starts_at], table[ends_at]
        loop = _joined(start, end, len(nodes))
        # Pieces that meet in one net of cracks reach for the same point, so that together they fill the whole.
        net = _joined(starts, ends, border)
        on_crack = np.zeros(border, dtype=bool)
        on_crack[starts] = True
        places = self._vertices[self._border_vertices]
        sizes = np.maximum(np.bincount(net, on_crack), 1.0)
        middles = np.stack([np.bincount(net, on_crack * places[:, axis]) / sizes for axis in range(3)], axis=1)
        reached = np.zeros(loop.max() + 1, dtype=np.int64)
        reached[loop] = net[nodes % border]
        fans = np.stack([count + end, count + start, count + len(nodes) + loop[start]], axis=1)
        return (
            np.concatenate([self._vertices, places[nodes % border], middles[reached]]),
            np.concatenate([faces, fans.astype(np.int32)]),
            np.concatenate([piece, edge_piece]),
        )

    def _impulses(
        self, scores: Float[Array, "v c"], mass: Float[Array, " v"], ends: Int[Array, " m"], counts: list[int]
    ) -> Float[Array, "v c3"]:
        """What each piece of each mode receives along each axis (column, axis) of a spread impulse at a vertex."""
        self._starts = ends - counts
        columns = list[Array]()
        for start, end, motion in zip(self._starts, ends, self._motions, strict=True):
            own = np.eye(end - start)[scores[:, start:end].argmax(axis=1)] * mass[:, None]
            columns.append(np.einsum("vp,pa->vpa", own, motion).reshape(len(mass), -1))
        return np.concatenate(columns, axis=1)

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
        self._atoms = _joined(owner[same], across[same], count)
        self._drop_crumbs(owner, across)
        self._atom_labels = np.zeros((len(self.labels), self._atoms.max() + 1), dtype=np.int64)
        self._atom_labels[:, self._atoms] = self.labels
        border = self._atoms[owner] != self._atoms[across]
        self._border_sides = np.stack([self._atoms[owner[border]], self._atoms[across[border]]])
        self._sides = np.unique(self._border_sides, axis=1)
        self._border_vertices = np.unique(starts[border])
        number = np.full(len(self._vertices), -1)
        number[self._border_vertices] = np.arange(len(self._border_vertices))
        self._border = np.stack([number[starts[border]], number[stops[border]]])
        """Edges between atoms, seen from each side, as numbers of border vertices."""
        self._corner = np.flatnonzero(number[self._faces.ravel()] >= 0)
        """Corners of faces on a border, flat: no other can come to lie on a crack."""
        self._corner_vertex = number[self._faces.ravel()[self._corner]]
        self._corner_atom = self._atoms[self._corner // 3]

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


def _joined(starts: Int[Array, " e"], ends: Int[Array, " e"], count: int) -> Int[Array, " n"]:
    """The connected component of each of `count` nodes."""
    graph = sp.coo_array((np.ones(len(starts), dtype=np.int8), (starts, ends)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


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
