"""Spots of the surface that the map leaves uncovered, and the pulls that draw the map over them.

Projections of mapped points never land on such a spot, so the projection loss is blind to it. The mean squared
distance from the surface to the map is not: where a surface point q lies far from the map, the gradient of
|q - g(x)|^2 at the closest mapped point g(x) draws g over the spot. From time to time surface points are looked for
beside the map; those that are far from it become pairs (x, q), which take part in every step until the next look,
each with the weight of a few samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.asset.dense_map import DenseMap, dense_map, even_samples
from ndf_core.config.fit import FitConfig
from ndf_core.fitting.blocks import NumpyField
from ndf_core.fitting.geometry import BaseGeometry, pushforward
from ndf_core.fitting.losses import Anchors
from ndf_core.fitting.network import Parameters
from ndf_core.fitting.projection import BoxProjector
from ndf_core.fitting.sampling import BasePoints, base_points_at
from ndf_core.kernels.bvh import TriangleBVH

_TRIANGLES = 20_000
"""Size of the mesh that finds the closest mapped points, before `closest_base_points` removes its chord error."""
_FAR = 8.0
"""Uncovered is what is farther from the map than this many times the map's rms distance from the surface ..."""
_FAR_EDGES = 1 / 16
"""... or than this share of an edge of the base mesh: where the whole map is poor, holes are no better for it."""
_LEAST_FAR = 1e-5
"""It is also farther than this, in the box: exact fits need no pulls."""
_WEIGHT = 4
"""Samples that each pull counts for."""
_MOST_ROWS = 16
"""At most one row in this many is a pull: early on, much lies far from the map, and projections do better."""
_PULLING = 0.8
"""Share of the run in which there are pulls."""
_NEWTON_STEPS = 3
_DAMPING = 1e-3


class Coverage:
    """The present pulls: a function of the parameters at the last look, and part of a checkpoint."""

    def __init__(self, geometry: BaseGeometry, projector: BoxProjector, config: FitConfig, threads: int) -> None:
        self._geometry, self._projector, self._config, self._threads = geometry, projector, config, threads
        self._due = config.coverage_every if config.coverage_every else config.steps + 1
        self._candidates = config.batch
        self._none = self._anchors(torch.zeros(0, dtype=torch.int64), torch.zeros(0, 3), torch.zeros(0, 3))
        self.pulls = self._none

    @property
    def state(self) -> dict[str, Tensor]:
        """Tensors of a checkpoint."""
        base = self.pulls.base
        return {
            "coverage.due": torch.tensor(self._due),
            "coverage.face": base.face,
            "coverage.barycentric": base.barycentric,
            "coverage.targets": self.pulls.targets,
        }

    def load_state(self, state: dict[str, Tensor]) -> None:
        self._due = int(state["coverage.due"])
        self.pulls = self._anchors(*(state[f"coverage.{name}"] for name in ("face", "barycentric", "targets")))

    @property
    def rows(self) -> int:
        """How many samples of each batch are pulls, from their share of the surface points that were looked at."""
        share = _WEIGHT * len(self.pulls.targets) / self._candidates
        return min(math.ceil(share * self._config.batch), self._config.batch // _MOST_ROWS)

    def look(self, parameters: Parameters, step: int) -> None:
        """Look again if it is time to. Near the end of the run there are no pulls, so that the map comes to rest."""
        if step >= _PULLING * self._config.steps:
            self.pulls = self._none
            return
        if step < self._due:
            return
        self._due = step + self._config.coverage_every
        rng = np.random.default_rng((self._config.seed, step))
        found = uncovered(parameters, self._geometry, self._projector, self._candidates, rng, self._threads)
        self.pulls = found or self._none

    def draw(self, generator: torch.Generator) -> Anchors:
        """`rows` of the pulls, at random."""
        base, targets = self.pulls.base, self.pulls.targets
        if not len(targets):
            return self.pulls
        chosen = torch.randint(len(targets), (self.rows,), generator=generator).to(targets.device)
        return Anchors(BasePoints(self._geometry, base.face[chosen], base.barycentric[chosen]), targets[chosen])

    def _anchors(self, face: Tensor, barycentric: Tensor, targets: Tensor) -> Anchors:
        device = self._geometry.device
        return Anchors(BasePoints(self._geometry, face.to(device), barycentric.to(device)), targets.to(device))


@torch.no_grad()
def uncovered(
    parameters: Parameters,
    geometry: BaseGeometry,
    projector: BoxProjector,
    candidates: int,
    rng: np.random.Generator,
    threads: int = 1,
) -> Anchors | None:
    """Surface points far from the mapped surface, each with the base point that is mapped closest to it.

    A surface point counts only where its normal agrees with the mapped normal of its pair: pulling the map across a
    gap or a thin wall would fold it. None where there is no such point, no normals, or no finite map.
    """
    field = NumpyField(parameters, geometry)
    dense = dense_map(len(geometry.faces), field.map, _TRIANGLES)
    if not np.isfinite(dense.vertices).all():
        return None  # the trainer will say so
    seen = _surface_points(field, dense, geometry, projector, candidates, rng)
    if seen is None:
        return None
    queries = seen.points.double().cpu().numpy()
    near, triangle, weights = TriangleBVH(dense.vertices, dense.triangles).closest(queries, threads)
    rows = np.flatnonzero(np.linalg.norm(near - queries, axis=1) > seen.far)
    start = base_points_at(geometry, *dense.base_points(triangle[rows], weights[rows]))
    chosen = torch.from_numpy(rows).to(geometry.device)
    targets = seen.points[chosen]
    base, distance, facing = closest_base_points(parameters, geometry, start, targets)
    keep = (distance > seen.far) & ((facing * seen.normals[chosen]).sum(1) > 0)
    return Anchors(BasePoints(geometry, base.face[keep], base.barycentric[keep]), targets[keep])


class _Seen(NamedTuple):
    points: Float[Tensor, "n 3"]
    normals: Float[Tensor, "n 3"]
    far: float
    """From which distance on a point counts as uncovered."""


def _surface_points(
    field: NumpyField,
    dense: DenseMap,
    geometry: BaseGeometry,
    projector: BoxProjector,
    count: int,
    rng: np.random.Generator,
) -> _Seen | None:
    """About `count` points of the surface near the map; None without normals.

    Any projector serves: points of the mapped surface are moved by about half an edge of the base mesh in a random
    direction and projected; off the map, they land on what it misses as well. Some stay, to see how far off it is.
    """
    faces, barycentric, directions = even_samples(dense, count, rng)
    mapped = field.map(faces, barycentric)
    stay = count // 4 + 1
    edge = math.sqrt(2.3 * float(geometry.areas.mean()))  # of an equilateral triangle of the mean area
    shift = rng.normal(0.0, 0.5 * edge / math.sqrt(3.0), mapped.shape)
    queries = torch.from_numpy(np.concatenate([mapped[:stay], mapped + shift])).float().to(geometry.device)
    along = torch.from_numpy(np.concatenate([directions[:stay], directions])).float().to(geometry.device)
    found = projector.project(queries, along if projector.needs_directions else None)
    if found.normals is None:
        return None
    rms = float((found.points - queries)[:stay].square().sum(1).mean().sqrt())
    known = found.converged & found.normals.any(dim=1)
    known[:stay] = False
    return _Seen(found.points[known], found.normals[known], max(min(_FAR * rms, _FAR_EDGES * edge), _LEAST_FAR))


def closest_base_points(
    parameters: Parameters, geometry: BaseGeometry, start: BasePoints, targets: Float[Tensor, "n 3"]
) -> tuple[BasePoints, Float[Tensor, " n"], Float[Tensor, "n 3"]]:
    """Base points in the faces of `start` that are mapped closest to `targets`, from there by Gauss-Newton.

    Returns the base points, the distances of their images from the targets, and the mapped unit normals there. No
    distance is larger than that of `start`.
    """
    corners = geometry.corner_positions[start.face]
    edges = corners[:, 1:] - corners[:, :1]
    barycentric = best = start.barycentric
    distance = torch.full((len(targets),), torch.inf, device=geometry.device)
    normal = torch.zeros_like(targets)
    for _ in range(_NEWTON_STEPS + 1):
        mapped, columns = pushforward(parameters, geometry, start.face, barycentric, edges)
        residual = targets - mapped
        length = torch.linalg.vector_norm(residual, dim=1)
        closer = length < distance
        best = torch.where(closer[:, None], barycentric, best)
        distance = torch.where(closer, length, distance)
        across = torch.nn.functional.normalize(torch.linalg.cross(columns[:, 0], columns[:, 1]), dim=1)
        normal = torch.where(closer[:, None], across, normal)
        # Weights of the second and third corner move by the solution of J J^T s = J r, damped where J is singular.
        gram = columns @ columns.transpose(1, 2)
        size = torch.diagonal(gram, dim1=1, dim2=2).mean(1).clamp_min(1e-30)
        gram = gram + _DAMPING * size[:, None, None] * torch.eye(2, device=gram.device)
        moved = barycentric[:, 1:] + torch.linalg.solve(gram, (columns @ residual[:, :, None])[:, :, 0])
        inside = torch.cat([1 - moved.sum(1, keepdim=True), moved], 1).clamp_min(0)
        barycentric = inside / inside.sum(1, keepdim=True)
    return BasePoints(geometry, start.face, best), distance, normal
