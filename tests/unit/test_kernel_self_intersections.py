"""`TriangleBVH.self_intersections` on constructed cases, and against exact rational arithmetic."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.reference import bvh as reference

Pairs = list[list[int]]
CROSSING = [[0, 1]]
TOUCHING: Pairs = []

# Corners of a first triangle, and in each case those of a second.
FIRST = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]
CASES: dict[str, tuple[list[list[float]], Pairs]] = {
    "crosses through the middle": ([[1, 1, -1], [1, 1, 1], [9, 9, 1]], CROSSING),
    "its edge passes through": ([[1, 1, -1], [1, 1, 1], [-9, -9, 3]], CROSSING),
    "edge through edge, symmetric": ([[2, 0, -1], [2, 0, 1], [2, 4, 0]], CROSSING),
    "ends of the crossing on two edges": ([[0, 2, -2], [0, 2, 2], [4, 2, 0]], CROSSING),
    "parallel above": ([[0, 0, 1], [4, 0, 1], [0, 4, 1]], TOUCHING),
    "crosses the plane beside it": ([[5, 5, -1], [5, 5, 1], [9, 9, 0]], TOUCHING),
    "a corner lies in it": ([[1, 1, 0], [2, 1, 3], [1, 2, 3]], TOUCHING),
    "an edge lies in it": ([[1, 1, 0], [2, 1, 0], [1, 2, 3]], TOUCHING),
    "shares a corner, away": ([[0, 0, 0], [-1, 0, 1], [-1, 0, -1]], TOUCHING),
    "shares a corner, its far edge crosses": ([[0, 0, 0], [2, 1, 1], [2, 2, -1]], CROSSING),
    "shares a corner, far edge beyond": ([[0, 0, 0], [9, 9, 1], [9, 9, -1]], CROSSING),
    "shares a corner, coplanar apart": ([[0, 0, 0], [-4, 0, 0], [0, -4, 0]], TOUCHING),
    "shares a corner, coplanar overlap": ([[0, 0, 0], [3, 1, 0], [1, 3, 0]], CROSSING),
    "shares an edge, flat": ([[0, 0, 0], [0, -4, 0], [4, 0, 0]], TOUCHING),
    "shares an edge, right angle": ([[0, 0, 0], [4, 0, 0], [2, 0, 4]], TOUCHING),
    "shares an edge, sharp fold": ([[0, 0, 0], [4, 0, 0], [1, 3, 1e-9]], TOUCHING),
    "shares an edge, folded onto it": ([[0, 0, 0], [4, 0, 0], [1, 3, 0]], CROSSING),
    "shares an edge, folded over it": ([[4, 0, 0], [0, 0, 0], [9, 9, 0]], CROSSING),
    "the same face": (FIRST, CROSSING),
    "the same face, reversed": (FIRST[::-1], CROSSING),
    "coplanar, inside": ([[1, 1, 0], [2, 1, 0], [1, 2, 0]], CROSSING),
    "coplanar, edges cross": ([[-1, 1, 0], [5, 1, 0], [5, 2, 0]], CROSSING),
    "coplanar, disjoint": ([[4, 4, 0], [8, 4, 0], [4, 8, 0]], TOUCHING),
    "coplanar, boxes overlap": ([[3, 3, 0], [4, 1, 0], [4, 4, 0]], TOUCHING),
    "coplanar, T-junction": ([[1, 0, 0], [3, 0, 0], [2, -4, 0]], TOUCHING),
    "degenerate through it": ([[1, 1, -1], [1, 1, 1], [1, 1, 0]], TOUCHING),
    "degenerate in it": ([[1, 1, 0], [1.5, 1, 0], [2, 1, 0]], TOUCHING),
}


@pytest.mark.parametrize("case", CASES)
def test_constructed_pairs(case: str) -> None:
    second, expected = CASES[case]
    corners = np.array(FIRST + second, dtype=float)
    for order in ([0, 1, 2, 3, 4, 5], [2, 0, 1, 5, 4, 3], [3, 4, 5, 0, 1, 2], [1, 0, 2, 4, 3, 5]):
        faces = np.arange(6).reshape(2, 3)
        assert TriangleBVH(corners[order], faces).self_intersections().tolist() == expected
        small = TriangleBVH(corners[order] * 1e-6 + 3, faces).self_intersections().tolist()
        assert small == (CROSSING if "sharp" in case else expected)  # that fold is below the rounding now


@pytest.mark.parametrize("case", CASES)
def test_shared_indices_and_equal_corners_are_the_same(case: str) -> None:
    second, expected = CASES[case]
    vertices, index = np.unique(np.array(FIRST + second, dtype=float), axis=0, return_inverse=True)
    assert TriangleBVH(vertices, index.reshape(2, 3)).self_intersections().tolist() == expected


def random_soup(seed: int) -> tuple[Float[Array, "v 3"], Float[Array, "f 3"]]:
    """On a small lattice, where everything touches everything, or in general position."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 14))
    vertices = rng.integers(0, rng.integers(2, 6), (count, 3)).astype(float) if seed % 3 else rng.random((count, 3))
    if seed % 5 == 0:
        vertices[:, 2] = 0
    return vertices, np.array([rng.choice(count, 3, replace=False) for _ in range(rng.integers(2, 20))])


@pytest.mark.parametrize("seeds", [range(i, i + 40) for i in range(0, 160, 40)])
def test_random_soups_agree_with_exact_arithmetic(seeds: range) -> None:
    found = 0
    for seed in seeds:
        vertices, faces = random_soup(seed)
        expected = reference.self_intersections(vertices, faces)
        assert TriangleBVH(vertices, faces).self_intersections().tolist() == expected.tolist()
        found += len(expected)
    assert found > 100


@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_a_turned_plane_stays_a_plane(offset: float) -> None:
    """Coplanar triangles stay so through the rounding of a rotation and a translation."""
    for seed in range(0, 60, 15):
        vertices, faces = random_soup(seed)
        expected = reference.self_intersections(vertices, faces)
        turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        found = TriangleBVH(vertices @ turn + offset, faces).self_intersections()
        assert found.tolist() == expected.tolist()


def test_the_limit_stops_the_search() -> None:
    vertices = np.tile([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], (20, 1))
    tree = TriangleBVH(vertices, np.arange(60).reshape(-1, 3))
    assert len(tree.self_intersections()) == 190
    assert tree.self_intersections(threads=3).tolist() == tree.self_intersections().tolist()
    assert len(tree.self_intersections(limit=7)) == 7
    assert tree.self_intersections(limit=0).shape == (0, 2)


@pytest.mark.parametrize("name", ["rocker-arm.obj", "fandisk.obj", "oded_sword.obj", "spot.obj", "oded_boot.obj"])
def test_clean_meshes_are_clean(name: str, shared_data: Path) -> None:
    vertices, faces = igl.read_triangle_mesh(str(shared_data / "mesh" / name))
    assert len(TriangleBVH(vertices, faces).self_intersections()) == 0
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    size = np.ptp(vertices, axis=0).max()
    assert len(TriangleBVH(vertices @ turn + 1e3 * size, faces).self_intersections()) == 0


def test_two_meshes_through_each_other_cross_along_closed_curves(shared_data: Path) -> None:
    """Every reported pair truly crosses; every face that another mesh's edge pierces is reported."""
    vertices, faces = igl.read_triangle_mesh(str(shared_data / "mesh" / "spot.obj"))
    size = np.ptp(vertices, axis=0).max()
    both = np.concatenate([vertices, vertices + size * np.array([0.1, 0.03, 0.02])])
    tree = TriangleBVH(both, np.concatenate([faces, faces + len(vertices)]))
    pairs = tree.self_intersections()
    assert np.all((pairs[:, 0] < len(faces)) & (pairs[:, 1] >= len(faces)))
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    t, pierced = TriangleBVH(vertices, faces).first_hit(both[start + len(vertices)], (both[end] - both[start]))
    first = t < 1
    edges = {
        (int(face), int(row) // 3 + len(faces))
        for row, face in zip(np.flatnonzero(first), pierced[first], strict=True)
    }
    assert len(edges) > 100
    assert edges <= set(map(tuple, pairs.tolist()))
    corners = both[np.concatenate([faces, faces + len(vertices)])]
    for one, two in pairs[:: max(1, len(pairs) // 100)]:
        local = np.concatenate([corners[one], corners[two]])
        assert reference.self_intersections(local, np.arange(6).reshape(2, 3)).tolist() == CROSSING
