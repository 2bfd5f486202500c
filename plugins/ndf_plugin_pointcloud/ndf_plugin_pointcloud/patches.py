"""Turning the parts of a soup to face outwards: by neighbours inside of a patch, by what sees the outside between."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.surfaces.edges import Edges
from ndf_plugin_pointcloud.triangles import Triangles

_SAMPLES, _FEWEST = 20_000, 8
"""Points that rays start from: in all, and of each patch."""
_RAYS = 8
"""From each side of each point."""
_MARGIN = 0.1
"""Difference of the two sides' share of rays that escape, from which a patch is turned over."""
_LIFT = 1e-5
"""Rays start this share of the size above the triangle."""


def orient_soup(soup: Triangles, seed: int = 0, threads: int = 1) -> tuple[Triangles, tuple[str, ...]]:
    """Triangles turned so that they face outwards where that means something.

    A patch is what is connected through edges with two triangles. Inside of it, the fewest triangles are turned that
    make neighbours agree (none where the patch is one-sided). Then rays tell which of its sides sees the outside: a
    patch is turned over where its back sees clearly more of it than its front. A sheet that both sides see, and what
    is hidden inside, stay as they are.

    Returns:
        The triangles, and what was done, for the user.
    """
    faces, patch, turned, one_sided = _agreeing(soup.faces, len(soup.vertices))
    front, back = _escapes(Triangles(soup.vertices, faces, ()), patch, np.random.default_rng(seed), threads)
    over = back > front + _MARGIN
    flips = over[patch]
    faces = np.where(flips[:, None], faces[:, ::-1], faces)
    notes: list[str] = []
    if turned:
        notes.append(f"{turned:,} triangles turned over to face the same way as their neighbours")
    if one_sided:
        notes.append(f"{one_sided:,} patches are one-sided and stay as they are")
    if flips.any():
        notes.append(
            f"{int(over.sum()):,} of {len(over):,} patches, {int(flips.sum()):,} triangles, turned over: their backs "
            "saw the outside"
        )
    return Triangles(soup.vertices, np.ascontiguousarray(faces), soup.notes), tuple(notes)


def _agreeing(faces: Int[Array, "f 3"], vertex_count: int) -> tuple[Int[Array, "f 3"], Int[Array, " f"], int, int]:
    """Faces that agree with their neighbours, their patches, how many were turned, and how many patches cannot agree.

    As in `ndf_core.surfaces.edges.orient`, a double cover decides: each face as it is and turned.
    """
    edges = Edges.of(faces, vertex_count)
    first = edges.first[edges.uses == 2]
    one, two = edges.order[first], edges.order[first + 1]
    count = len(faces)
    left, right = one // 3, two // 3
    across = np.where(faces.ravel()[one] == faces.ravel()[two], count, 0)
    half = _connected(
        2 * count,
        np.concatenate([left, left + count]),
        np.concatenate([right + across, right + count - across]),
    )
    patch = _connected(count, left, right)
    as_is, other = half[:count], half[count:]
    one_sided = np.unique(patch[as_is == other])
    kept = np.bincount(as_is, minlength=2 * count)
    turn = (kept[other] > kept[as_is]) | ((kept[other] == kept[as_is]) & (other < as_is))
    turn &= as_is != other
    return np.where(turn[:, None], faces[:, ::-1], faces), patch, int(turn.sum()), len(one_sided)


def _escapes(
    soup: Triangles, patch: Int[Array, " f"], rng: np.random.Generator, threads: int
) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
    """Share of random rays from the front and from the back of each patch that meet nothing."""
    patches = int(patch.max()) + 1
    points, normals, face = soup.sample(_SAMPLES, rng)
    # Small patches may have got no sample: some from each patch's faces, whatever their area.
    order = np.argsort(patch, kind="stable")
    starts = np.searchsorted(patch[order], np.arange(patches))
    sizes = np.bincount(patch, minlength=patches)
    extra = order[(starts[:, None] + rng.integers(0, 1 << 30, (patches, _FEWEST)) % sizes[:, None]).ravel()]
    vectors = soup.area_vectors[extra]
    middles = soup.vertices[soup.faces[extra]].mean(axis=1)
    points, face = np.concatenate([points, middles]), np.concatenate([face, extra])
    normals = np.concatenate([normals, vectors / np.linalg.norm(vectors, axis=1, keepdims=True)])
    tree = TriangleBVH(soup.vertices, soup.faces)
    shares: list[Float[Array, " p"]] = []
    for side in (1.0, -1.0):
        up = np.repeat(side * normals, _RAYS, axis=0)
        # A point of the unit sphere on the tip of the normal: directions in proportion to their cosine (Lambert).
        ball = rng.standard_normal(up.shape)
        ways = up + ball / np.linalg.norm(ball, axis=1, keepdims=True) * (1 - 1e-6)
        hit = tree.first_hit(np.repeat(points, _RAYS, axis=0) + _LIFT * soup.size * up, ways, threads)[1]
        free = (hit < 0).reshape(-1, _RAYS).mean(axis=1)
        shares.append(np.bincount(patch[face], free, patches) / np.bincount(patch[face], minlength=patches))
    return shares[0], shares[1]


def _connected(count: int, rows: Int[Array, " m"], columns: Int[Array, " m"]) -> Int[Array, " n"]:
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])
