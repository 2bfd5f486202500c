"""Fast winding numbers of triangles and of oriented points: the interface of `src/winding.c`."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels import _winding  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub
from ndf_core.kernels.bvh import share_rows

BETA = 2.25
"""Groups of sources farther than this many of their radii are taken together."""
_LONGEST = (0.4, 0.2, 0.1)
"""Edges, as shares of the size, that triangles are cut down to, one after the other, as long as ..."""
_GROWTH, _PIECES = 2, 50_000
"""... there are at most so many times as many pieces, and so many more."""


class WindingTree:
    """The generalised winding number w of a set of sources, and its gradient.

    w is 1 inside of closed, outwards oriented sources, 0 outside, and in between near holes. The sources are copied.
    Queries and answers are in the sources' own frame and units, float64; inside, coordinates are recentred, scaled
    and rounded to float32, so that positions are good to 1e-7 of the sources' size.

    Law: every answer is a pure function of its query. It does not depend on the other rows, their order or the
    number of threads.

    Reference: Jacobson, Kavan and Sorkine-Hornung 2013; Barill et al. 2018 (Taylor series up to its second order).
    """

    def __init__(self, tree: object) -> None:
        self._tree = tree

    @classmethod
    def of_triangles(cls, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], beta: float = BETA) -> WindingTree:
        """Any triangles: open, non-manifold, intersecting. w jumps by one across each.

        Raises:
            ValueError: there is no face, an index is out of range, or a coordinate is not finite.
        """
        vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
        if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
            raise ValueError("faces: need at least one, and indices in range")
        corners = _cut_long(vertices[faces])
        return cls(_winding.build(np.ascontiguousarray(corners).reshape(-1, 9), None, None, beta))

    @classmethod
    def of_points(
        cls,
        points: Float[Array, "n 3"],
        area_vectors: Float[Array, "n 3"],
        radii: Float[Array, " n"],
        beta: float = BETA,
    ) -> WindingTree:
        """Points that stand for a piece of surface each: dipoles, spread over balls so that w is smooth.

        A dipole alone is infinite at its point. Spread with a density in proportion to 1 - (r / R)^2 it is unchanged
        outside of its ball, and w turns from 0 to 1 over about one radius on each side of the surface.

        Args:
            points: sources.
            area_vectors: outward unit normal times area, units squared.
            radii: of the balls; about the distance between neighbours.
            beta: groups of points farther than this many of their radii are taken together.

        Raises:
            ValueError: there is no point, or a number is not finite.
        """
        arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in (points, area_vectors, radii)]
        return cls(_winding.build(*arrays, beta))

    def values(self, queries: Float[Array, "n 3"], threads: int = 1) -> Float[Array, " n"]:
        """w at each query."""
        return self._evaluate(queries, threads, None)

    def values_and_gradients(
        self, queries: Float[Array, "n 3"], threads: int = 1
    ) -> tuple[Float[Array, " n"], Float[Array, "n 3"]]:
        """w and its gradient (per unit of length) at each query."""
        gradients = np.empty((len(queries), 3))
        return self._evaluate(queries, threads, gradients), gradients

    def trace(
        self,
        origins: Float[Array, "n 3"],
        directions: Float[Array, "n 3"],
        heights: Float[Array, " n"],
        steps: Float[Array, " n"],
        reaches: Float[Array, " n"],
        tolerance: float,
        threads: int = 1,
    ) -> Float[Array, " n"]:
        """Distance along each direction, negative backwards, to the level set w = 1/2.

        A ray runs along its direction from inside and against it from outside, to a sign change of w - 1/2 that is
        bracketed within `tolerance`.

        Args:
            origins: starts.
            directions: unit vectors that point about outwards.
            heights: estimated heights over the level set; how good they are decides the time, not the answer.
            steps: first step of a ray that finds nothing there; later ones grow with the way done.
            reaches: longest way.
            tolerance: width of the bracket.
            threads: rows are shared out over this many threads.

        Returns:
            The distances; NaN where no sign change was found.

        Reference: Gillespie, Yang, Botsch and Crane, Ray tracing harmonic functions, 2024, whose steps these replace.
        """
        arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in (origins, directions, heights, steps, reaches)]
        found = np.empty(len(origins))

        def run(part: slice) -> None:
            _winding.trace(self._tree, found[part], *(x[part] for x in arrays), tolerance)

        share_rows(run, len(found), threads)
        return found

    def _evaluate(
        self, queries: Float[Array, "n 3"], threads: int, gradients: Float[Array, "n 3"] | None
    ) -> Float[Array, " n"]:
        queries = np.ascontiguousarray(queries, dtype=np.float64)
        values = np.empty(len(queries))

        def run(part: slice) -> None:
            some = None if gradients is None else gradients[part]
            _winding.evaluate(self._tree, values[part], some, queries[part])

        share_rows(run, len(queries), threads)
        return values


def _cut_long(triangles: Float[Array, "f 3 3"]) -> Float[Array, "m 3 3"]:
    """The same surface in pieces without very long edges: a group with a long triangle is far from nothing."""
    finite = triangles[np.isfinite(triangles).all(axis=(1, 2))].reshape(-1, 3)
    size = float(np.ptp(finite, axis=0).max()) if len(finite) else 0.0
    most = _GROWTH * len(triangles) + _PIECES
    for share in _LONGEST:
        while True:
            length = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
            edge = length.argmax(axis=1)
            long = length.max(axis=1) > share * size
            if not long.any():
                break
            if len(triangles) + int(long.sum()) > most:
                return triangles
            row, first = np.flatnonzero(long), edge[long]
            a, b, c = (triangles[row, (first + k) % 3] for k in range(3))
            middle = (a + b) / 2
            pieces = [np.stack(corners, axis=1) for corners in ((a, middle, c), (middle, b, c))]
            triangles = np.concatenate([triangles[~long], *pieces])
    return triangles
