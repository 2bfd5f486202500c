"""Closest points, ray hits and self-intersections of a triangle mesh through a bounding volume hierarchy."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.kernels import _bvh  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub

_LEAST_ROWS_PER_THREAD = 1024


class TriangleBVH:
    """A triangle mesh, indexed for distance and ray queries.

    Any triangles will do: open, non-manifold, intersecting; degenerate ones count as segments or points. The mesh is
    copied. Queries and answers are in the mesh's own frame and units, float64; inside, coordinates are recentred and
    scaled, so that neither a large offset nor a small size costs precision.

    Law: every answer is a pure function of its query. It does not depend on the other rows, their order or the
    number of threads; equally distant faces are resolved to the smallest face index.
    """

    def __init__(self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> None:
        """Build the tree in O(f log f).

        Raises:
            ValueError: there is no face, an index is out of range, or a coordinate is not finite.
        """
        vertices = _rows(vertices, "vertices")
        faces = np.asarray(faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
            raise ValueError(f"faces: need an integer array (f, 3), got {faces.dtype} {faces.shape}")
        outside = ((faces < 0) | (faces >= len(vertices))).any(axis=1)
        if outside.any():
            row = int(outside.argmax())
            raise ValueError(f"faces: row {row} names a vertex outside 0..{len(vertices) - 1}")
        self._tree = _bvh.build(vertices, np.ascontiguousarray(faces, dtype=np.int32))

    def closest(
        self, points: Float[Array, "n 3"], threads: int = 1
    ) -> tuple[Float[Array, "n 3"], Int[Array, " n"], Float[Array, "n 3"]]:
        """Closest point of the mesh for each query point.

        Args:
            points: queries, float64, in the mesh's units; any distance from the mesh.
            threads: rows are shared out over this many threads.

        Returns:
            The closest points, their faces (int32), and their barycentric coordinates in those faces (each row
            non-negative and summing to 1). A vertex of the mesh is returned exactly.

        Raises:
            ValueError: a query is not finite.
        """
        points = _rows(points, "queries")
        count = len(points)
        found, faces, weights = np.empty((count, 3)), np.empty(count, np.int32), np.empty((count, 3))

        def run(part: slice) -> None:
            _bvh.closest(self._tree, points[part], found[part], faces[part], weights[part])

        share_rows(run, count, threads)
        return found, faces, weights

    def first_hit(
        self, origins: Float[Array, "n 3"], directions: Float[Array, "n 3"], threads: int = 1
    ) -> tuple[Float[Array, " n"], Int[Array, " n"]]:
        """First face that each ray ``origin + t * direction``, t >= 0, meets, from either side.

        Watertight: a ray through an edge or a corner shared by two faces hits one of them.

        Args:
            origins: float64, in the mesh's units.
            directions: float64, of any length but zero.
            threads: rows are shared out over this many threads.

        Returns:
            t (in lengths of the direction; inf where nothing is hit) and the faces (int32; -1 there).

        Raises:
            ValueError: an origin or direction is not finite, or a direction is zero.
        """
        origins, directions = _rows(origins, "origins"), _rows(directions, "directions")
        t, faces = np.empty(len(origins)), np.empty(len(origins), np.int32)

        def run(part: slice) -> None:
            _bvh.first_hit(self._tree, origins[part], directions[part], t[part], faces[part])

        if len(origins) != len(directions):
            raise ValueError(f"directions: need {len(origins)} rows like the origins, got {len(directions)}")
        share_rows(run, len(origins), threads)
        return t, faces

    def self_intersections(self, limit: int | None = None, threads: int = 1) -> Int[Array, "k 2"]:
        """Pairs of faces that properly intersect, the smaller index first, in lexicographic order.

        Two faces properly intersect when they cross over a length greater than zero, or lie in a common plane and
        overlap over an area. Touching is not intersecting: common corners and edges, a corner or an edge of one
        lying in the other, T-junctions. Neighbours are reported when they cross beyond what they share, or are
        folded onto each other; so are duplicates of a face. Degenerate faces have no interior and are never
        reported.

        Contact within rounding is touching: decisions are made in double arithmetic, and whatever its error bound, or
        moving each coordinate by two units in the last place of the mesh's largest coordinate, could turn into
        touching counts as touching. Planes that differ by less are one plane. No other tolerance is used.

        Args:
            limit: stop after this many pairs (which ones depends only on the mesh).
            threads: faces are shared out over this many threads, unless there is a limit.
        """
        if limit is not None and limit < 0:
            raise ValueError(f"limit: need at least 0, got {limit}")
        parts = threads if limit is None else 1

        def find(part: int) -> bytearray:
            return _bvh.self_intersections(self._tree, 2**62 if limit is None else limit, part, parts)

        with ThreadPoolExecutor(parts) as pool:
            found = b"".join(pool.map(find, range(parts)))
        pairs = np.frombuffer(found, dtype=np.int32).reshape(-1, 2)
        return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _rows(values: Float[Array, "n 3"], name: str) -> Float[Array, "n 3"]:
    rows = np.ascontiguousarray(values, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"{name}: need an array (n, 3), got {rows.shape}")
    return rows


def share_rows(run: Callable[[slice], None], count: int, threads: int) -> None:
    """Call `run` on consecutive slices of the rows, one per thread; the kernels release the GIL."""
    if threads < 1:
        raise ValueError(f"threads: need at least 1, got {threads}")
    workers = min(threads, max(1, count // _LEAST_ROWS_PER_THREAD))
    if workers == 1:
        run(slice(0, count))
        return
    bounds = [count * i // workers for i in range(workers + 1)]
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, map(slice, bounds[:-1], bounds[1:])))
