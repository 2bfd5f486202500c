"""Draw a mesh over another of the same topology, led by anchors: where the map between two shapes starts.

The mesh flows in small steps. Each step solves for a smooth displacement (graph Laplacian and its square, from stiff
to soft) that takes anchors part of their way and vertices towards the target, in both directions: the closest target
point of each vertex, and for points spread over the target the closest point of the mesh, so that limbs are entered.
Pairs whose normals disagree count for nothing. Between steps vertices move along the surface to the middle of their
neighbours, which keeps triangles from piling up in creases; neighbours across large triangles count for more, so that
vertices follow into limbs, which a few triangles would otherwise have to cover. What is folded in the end is smoothed
in growing patches: inside a patch that is nearly flat, vertices amid their neighbours fold nowhere (Tutte).

Reference: non-rigid registration with decreasing stiffness, Amberg, Romdhani and Vetter 2007; for App. D.1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.sparse.linalg import splu

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals, unit, vertex_normals

_STEPS = 100
_STIFFNESS = (2.5, -2.0)
"""Decimal logarithm of the weight of smoothness at the first and last step, beside `_ATTRACTION`."""
_MEMBRANE = 0.1
"""Weight of the Laplacian beside its square."""
_ATTRACTION = 0.3
_ANCHOR = 30.0
_SPREAD = 3000
"""Target points of each step."""
_SPREADING = 4.0
"""Anchors that are put right take along what is within some two (its root) edges of them."""
_RELAXED = 0.5
"""Half-way to the middle of the neighbours, three times a step."""
_LEAST_AREA = 1e-3
"""Triangles without area count as this share of the mean one, so that every vertex has a middle to go to."""
_ROUNDS = 12
"""Times that folded patches are smoothed, each time larger ones."""


class PlacedAnchors(NamedTuple):
    """Points of a mesh, and where they go on a surface."""

    faces: Int[Array, " m"]
    weights: Float[Array, "m 3"]
    goals: Float[Array, "m 3"]


class Target:
    """The surface that the mesh is drawn over."""

    def __init__(self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> None:
        self.vertices, self.faces = vertices, faces
        self.tree = TriangleBVH(vertices, faces)
        crossed = face_normals(vertices, faces)
        areas = np.linalg.norm(crossed, axis=1)
        self.normals = unit(crossed)
        self._shares = areas / areas.sum()

    def spread(self, count: int, rng: np.random.Generator) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
        """Random points, even by area, and the normals there."""
        chosen = rng.choice(len(self.faces), count, p=self._shares)
        weights = rng.dirichlet((1.0, 1.0, 1.0), count)
        return np.einsum("nc,ncx->nx", weights, self.vertices[self.faces[chosen]]), self.normals[chosen]

    def folded(self, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Bool[Array, " f"]:
        """Triangles of a mesh near the target that face against it."""
        closest = self.tree.closest(vertices[faces].mean(axis=1))[1]
        return (face_normals(vertices, faces) * self.normals[closest]).sum(axis=1) < 0


def register(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    target: Target,
    anchors: PlacedAnchors,
    seed: int,
) -> Float[Array, "v 3"]:
    """Positions of the mesh's vertices on the target, a map that anchors fix and that folds as little as it can.

    Args:
        vertices, faces: the mesh, roughly of the target's size and place.
        target: of the same topology.
        anchors: points of the mesh; they are met exactly.
        seed: of the points on the target.
    """
    return _Registration(vertices, faces, target, anchors).run(np.random.default_rng(seed))


def nearest_rotation(points: Float[Array, "k 3"], goals: Float[Array, "k 3"]) -> Float[Array, "3 3"]:
    """The rotation R for which points @ R are nearest to `goals` (Kabsch)."""
    left, _, right = np.linalg.svd(points.T @ goals)
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right


class _Registration:
    def __init__(
        self,
        vertices: Float[Array, "v 3"],
        faces: Int[Array, "f 3"],
        target: Target,
        anchors: PlacedAnchors,
    ) -> None:
        self._now, self._faces, self._target = vertices, faces, target
        count = len(vertices)
        self._adjacent = self._by_edges(np.full(len(faces), 0.5))
        degrees = np.asarray(self._adjacent.sum(axis=1)).ravel()
        laplacian = sp.diags(degrees) - self._adjacent
        self._smoothness = _MEMBRANE * laplacian + laplacian @ laplacian
        self._anchored = self._at(anchors.faces, anchors.weights)
        self._goals = anchors.goals
        # The smoothest small change that puts the anchors right; pairs may contradict each other.
        spread = splu(sp.csc_matrix(sp.identity(count) + _SPREADING * laplacian)).solve(self._anchored.T.toarray())
        self._correction = spread @ np.linalg.pinv(self._anchored @ spread)

    def run(self, rng: np.random.Generator) -> Float[Array, "v 3"]:
        for step in range(_STEPS):
            progress = step / (_STEPS - 1)
            self._flow(step, progress, rng)
            for _ in range(3):
                self._relax(on_target=progress > 0.3)
                if progress > 0.55:
                    self._meet_anchors()
        self._unfold()
        return self._now

    def _flow(self, step: int, progress: float, rng: np.random.Generator) -> None:
        """One step of the flow; vertices and target attract each other fully from the middle on."""
        now, faces, target = self._now, self._faces, self._target
        attraction = _ATTRACTION * min(1.0, 2 * progress)
        normals = face_normals(now, faces)
        closest, hit, _ = target.tree.closest(now)
        facing = (vertex_normals(now, faces) * target.normals[hit]).sum(axis=1)
        pull = attraction * facing.clip(0, 1)
        points, directions = target.spread(_SPREAD, rng)
        _, under, weights = TriangleBVH(now, faces).closest(points)
        facing = (unit(normals)[under] * directions).sum(axis=1)
        share = sp.diags(attraction * facing.clip(0, 1) * len(now) / _SPREAD)
        spread = self._at(under, weights)
        remaining = max(1.0, _STEPS / 2 - step)
        stiffness = 10 ** (_STIFFNESS[0] + (_STIFFNESS[1] - _STIFFNESS[0]) * progress)
        matrix = stiffness * self._smoothness + sp.diags(pull + 1e-6) + spread.T @ share @ spread
        matrix = matrix + _ANCHOR * self._anchored.T @ self._anchored
        right = pull[:, None] * (closest - now) + spread.T @ (share @ (points - spread @ now))
        right = right + _ANCHOR / remaining * self._anchored.T @ (self._goals - self._anchored @ now)
        self._now = now + splu(sp.csc_matrix(matrix)).solve(right)

    def _relax(self, on_target: bool) -> None:
        """Vertices along the surface towards the middle of their neighbours."""
        if on_target:
            normals = self._target.normals[self._target.tree.closest(self._now)[1]]
        else:
            normals = vertex_normals(self._now, self._faces)
        shift = self._middle() @ self._now - self._now
        self._now = self._now + _RELAXED * (shift - (shift * normals).sum(axis=1, keepdims=True) * normals)

    def _meet_anchors(self) -> None:
        self._now = self._now + self._correction @ (self._goals - self._anchored @ self._now)

    def _unfold(self) -> None:
        """Smooth folded patches; the best of all rounds is kept."""
        least, best = np.inf, self._now
        for round_ in range(_ROUNDS + 1):
            folded = self._target.folded(self._now, self._faces)
            share = self._area_of(folded)
            if share < least:
                least, best = share, self._now
            if not folded.any() or round_ == _ROUNDS:
                break
            patch = np.zeros(len(self._now))
            patch[self._faces[folded]] = 1.0
            for _ in range(2 + round_):
                patch = ((self._adjacent @ patch + patch) > 0).astype(float)
            moving, middle = patch[:, None], self._middle()
            for _ in range(10 + 5 * round_):
                self._now = self._now + 0.7 * moving * (middle @ self._now - self._now)
                self._now = self._now + moving * (self._target.tree.closest(self._now)[0] - self._now)
                self._meet_anchors()
        self._now = best

    def _area_of(self, chosen: Bool[Array, " f"]) -> float:
        return float(np.linalg.norm(face_normals(self._now, self._faces), axis=1)[chosen].sum())

    def _middle(self) -> sp.csr_matrix:
        """The matrix that takes vertices to the middle of their neighbours, weighed by the triangles between."""
        areas = np.linalg.norm(face_normals(self._now, self._faces), axis=1)
        drawn = self._by_edges(areas + _LEAST_AREA * areas.mean())
        return sp.diags(1 / np.asarray(drawn.sum(axis=1)).ravel()) @ drawn

    def _by_edges(self, values: Float[Array, " f"]) -> sp.csr_matrix:
        """The symmetric matrix that has for each edge the sum of its triangles' values."""
        ends = (self._faces.ravel(), self._faces[:, [1, 2, 0]].ravel())
        one_way = sp.coo_matrix((np.repeat(values, 3), ends), shape=(len(self._now),) * 2).tocsr()
        return one_way + one_way.T

    def _at(self, faces: Int[Array, " n"], weights: Float[Array, "n 3"]) -> sp.csr_matrix:
        """The matrix that takes values at vertices to points of faces."""
        rows = np.repeat(np.arange(len(faces)), 3)
        columns = self._faces[faces].ravel()
        return sp.csr_matrix((weights.ravel(), (rows, columns)), shape=(len(faces), len(self._now)))
