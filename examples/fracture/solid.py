"""A coarse solid of tetrahedra inside a closed surface, and linear elasticity on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import Delaunay, KDTree

from ndf_core.kernels.winding import WindingTree

_FLAT = 0.02
"""Tetrahedra of less volume than this share of a regular one with their longest edge are left out."""


@dataclass(frozen=True)
class Solid:
    """Tetrahedra, each with four corners of its own: neighbours may come apart (the exploded mesh)."""

    points: Float[Array, "p 3"]
    tetrahedra: Int[Array, "t 4"]

    @cached_property
    def volumes(self) -> Float[Array, " t"]:
        edges = self.points[self.tetrahedra[:, 1:]] - self.points[self.tetrahedra[:, :1]]
        return np.abs(np.linalg.det(edges)) / 6

    @cached_property
    def centers(self) -> Float[Array, "t 3"]:
        return self.points[self.tetrahedra].mean(axis=1)

    @cached_property
    def walls(self) -> tuple[Int[Array, "w 2"], Int[Array, "w 2 3"], Float[Array, " w"]]:
        """Triangles between two tetrahedra: the two, their own corners (exploded) there in the same order, areas."""
        found: dict[tuple[int, ...], list[int]] = {}
        for index, corners in enumerate(self.tetrahedra.tolist()):
            for three in combinations(sorted(corners), 3):
                found.setdefault(three, []).append(index)
        shared = [(key, pair) for key, pair in found.items() if len(pair) == 2]
        keys, pairs = np.array([key for key, _ in shared]), np.array([pair for _, pair in shared])
        slots = (self.tetrahedra[pairs][:, :, None, :] == keys[:, None, :, None]).argmax(axis=3)
        corners = self.points[keys]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        return pairs, 4 * pairs[:, :, None] + slots, areas

    @cached_property
    def stiffness(self) -> sp.csc_array:
        """Twice the elastic energy (Lame constants 1) of a displacement of all exploded corners, (12 t, 12 t)."""
        edges = self.points[self.tetrahedra[:, 1:]] - self.points[self.tetrahedra[:, :1]]
        slopes = np.linalg.inv(edges).transpose(0, 2, 1)  # gradients of the weights of corners 1, 2, 3
        slopes = np.concatenate([-slopes.sum(axis=1, keepdims=True), slopes], axis=1)
        strain = np.zeros((len(edges), 6, 12))  # xx, yy, zz and, times sqrt 2, xy, yz, zx
        for corner in range(4):
            for axis in range(3):
                strain[:, axis, 3 * corner + axis] = slopes[:, corner, axis]
            for row, (a, b) in enumerate(((0, 1), (1, 2), (2, 0)), start=3):
                strain[:, row, 3 * corner + a] = slopes[:, corner, b] / 2**0.5
                strain[:, row, 3 * corner + b] = slopes[:, corner, a] / 2**0.5
        law = 2 * np.eye(6)
        law[:3, :3] += 1
        blocks = np.einsum("tri,rs,tsj,t->tij", strain, law, strain, self.volumes)
        return sp.csc_array(sp.block_diag(list(blocks)))

    @cached_property
    def mass(self) -> Float[Array, " c"]:
        """Volume that each number of a displacement stands for, (12 t,)."""
        return np.repeat(self.volumes / 4, 12)

    @cached_property
    def jumps(self) -> sp.csr_array:
        """What neighbours differ by at the three corners of each wall, rows (wall, corner, axis)."""
        _, corners, _ = self.walls
        rows = np.arange(9 * len(corners))
        ones = np.ones(len(rows))
        sides = [(3 * corners[:, side, :, None] + np.arange(3)).ravel() for side in (0, 1)]
        shape = (len(rows), 12 * len(self.tetrahedra))
        return sp.csr_array((ones, (rows, sides[0])), shape) - sp.csr_array((ones, (rows, sides[1])), shape)


def solid_inside(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], spacing: float, seed: int = 0) -> Solid:
    """Delaunay tetrahedra of the surface's vertices, thinned to `spacing`, and of a shaken lattice inside."""
    rng = np.random.default_rng(seed)
    surface = vertices[_thinned(vertices, spacing, rng)]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    axes = [np.arange(a + spacing / 2, b, spacing) for a, b in zip(low, high, strict=True)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = lattice + rng.uniform(-0.3, 0.3, lattice.shape) * spacing
    tree = WindingTree.of_triangles(vertices, faces)
    lattice = lattice[tree.values(lattice) > 0.5]
    lattice = lattice[KDTree(surface).query(lattice)[0] > 0.5 * spacing]
    points = np.concatenate([surface, lattice])
    tetrahedra = Delaunay(points).simplices
    corners = points[tetrahedra]
    longest = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3).max(axis=(1, 2))
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    kept = (tree.values(corners.mean(axis=1)) > 0.5) & (volumes > _FLAT * longest**3 / (6 * 2**0.5))
    return Solid(points, _largest_part(tetrahedra[kept]))


def _thinned(points: Float[Array, "n 3"], radius: float, rng: np.random.Generator) -> list[int]:
    """Points no two of which are closer than the radius, and none of the others farther than that from all."""
    tree, taken, free = KDTree(points), list[int](), np.ones(len(points), dtype=bool)
    for index in rng.permutation(len(points)):
        if free[index]:
            taken.append(int(index))
            free[tree.query_ball_point(points[index], radius)] = False
    return taken


def _largest_part(tetrahedra: Int[Array, "t 4"]) -> Int[Array, "s 4"]:
    """Only what hangs together by walls can be shaken as one body."""
    whole = Solid(np.zeros((int(tetrahedra.max()) + 1, 3)), tetrahedra)
    pairs = whole.walls[0]
    graph = sp.coo_array((np.ones(len(pairs)), pairs.T), shape=(len(tetrahedra),) * 2)
    part = sp.csgraph.connected_components(graph, directed=False)[1]
    return tetrahedra[part == np.bincount(part).argmax()]
