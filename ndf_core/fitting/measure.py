"""Two-sided error of a field against its surface, measured with fresh samples spread evenly by area."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from ndf_core.asset.dense_map import DenseMap, Map, dense_map, even_samples
from ndf_core.fitting.projection import BoxProjector
from ndf_core.interfaces import Surface
from ndf_core.kernels.bvh import TriangleBVH

_PROBES = 32
"""Places around a point from which the surface near it is looked for."""
_MOST_PROBED = 500
"""Points that are looked around; of more, an even share."""

Inverse = Callable[[Float[Array, "n 3"]], Float[Array, "n 3"]]


@dataclass(frozen=True)
class Distance:
    """Statistics of distances, as shares of the longest side of the base mesh."""

    rms: float
    mean: float
    p99: float
    max: float


@dataclass(frozen=True)
class Accuracy:
    """Error of a field. Lengths are shares of the longest side."""

    field_to_surface: Distance
    surface_to_field: Distance | None
    """None where the surface cannot be sampled."""
    cycle_loss: float | None
    """Mean of |inverse(g(x)) - x|^2 in the box frame (Sec. 3.2); None without an inverse network."""
    against_area: float | None
    """Share of the mapped area that faces against the surface's normal at its projection; None without normals."""
    folded_area: float | None
    """What of it faces against all of the surface near it: within three times its distance, or the rms distance."""
    converged: float
    """Share of the samples that could be projected."""
    samples: int

    @property
    def two_sided_rms(self) -> float:
        """The larger of the two directions' rms."""
        other = self.surface_to_field
        return max(self.field_to_surface.rms, other.rms) if other else self.field_to_surface.rms

    def as_dict(self) -> dict[str, object]:
        return asdict(self)


def measure(
    mapping: Map,
    face_count: int,
    surface: Surface,
    center: Float[Array, "3"],
    scale: float,
    base_positions: Map,
    inverse: Inverse | None = None,
    samples: int = 100_000,
    seed: int = 0,
    threads: int = 1,
) -> Accuracy:
    """Measure a field with fresh samples, in both directions.

    Args:
        mapping: the field g, box frame.
        face_count: faces of the base mesh.
        surface: what the field was fitted to, input units.
        center, scale: x_input = x_box * scale + center.
        base_positions: base points themselves, box frame (for the cycle loss).
        inverse: the inverse network, box frame.
        samples: number of samples on each side.
        seed: of the samples.
        threads: for projections and closest points.
    """
    dense = dense_map(face_count, mapping)
    rng = np.random.default_rng(seed)
    faces, barycentric, normals = even_samples(dense, samples, rng)
    mapped = mapping(faces, barycentric).astype(np.float64)
    projector = BoxProjector(surface.projector, center, scale, threads)
    directions = torch.from_numpy(normals) if projector.needs_directions else None
    projection = projector.project(torch.from_numpy(mapped), directions)
    converged = projection.converged.numpy()
    distance = np.linalg.norm(mapped - projection.points.numpy(), axis=1)[converged]
    against = folded = None
    if projection.normals is not None and len(distance):
        rows = np.flatnonzero(((normals * projection.normals.numpy()).sum(1) < 0) & converged)
        against = folded = len(rows) / len(distance)
        if len(rows):
            rows = rows[:: -(-len(rows) // _MOST_PROBED)]
            away = np.linalg.norm(mapped[rows] - projection.points.numpy()[rows], axis=1)
            reach = 3 * np.maximum(away, np.sqrt((distance**2).mean()))
            folded *= float(facing_away(mapped[rows], normals[rows], reach, projector).mean())
    cycle = None
    if inverse is not None:
        cycle = float(((inverse(mapped) - base_positions(faces, barycentric)) ** 2).sum(1).mean())
    return Accuracy(
        field_to_surface=_statistics(distance),
        surface_to_field=_surface_to_field(dense, surface, center, scale, samples, rng, threads),
        cycle_loss=cycle,
        against_area=against,
        folded_area=folded,
        converged=float(converged.mean()),
        samples=samples,
    )


def facing_away(
    points: Float[Array, "n 3"], normals: Float[Array, "n 3"], reach: Float[Array, " n"], projector: BoxProjector
) -> Bool[Array, " n"]:
    """Which of these points face against all of the surface within `reach`: on folds, not beside sharp edges.

    Beside an edge that bends by more than 90 degrees the closest point may lie across it, and its normal against the
    map's, without any fold: a surface moved along its own normals has such points, as far from the edge as it was
    moved. So the surface is also projected to from a sphere around each.
    """
    probes = (points[:, None] + reach[:, None, None] * _sphere(_PROBES)).reshape(-1, 3)
    directions = np.repeat(normals, _PROBES, axis=0)
    found = projector.project(
        torch.from_numpy(probes), torch.from_numpy(directions) if projector.needs_directions else None
    )
    assert found.normals is not None, "the surface has normals"
    away = np.linalg.norm(found.points.numpy() - np.repeat(points, _PROBES, axis=0), axis=1)
    along = (found.normals.numpy() * directions).sum(1) > 0
    near = (away <= np.repeat(reach, _PROBES)) & found.converged.numpy()
    return ~(near & along).reshape(-1, _PROBES).any(1)


def _sphere(count: int) -> Float[Array, "n 3"]:
    """Unit vectors spread evenly (Fibonacci)."""
    step = np.arange(count) + 0.5
    polar, around = np.arccos(1 - 2 * step / count), np.pi * (1 + 5**0.5) * step
    return np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)


def _surface_to_field(
    dense: DenseMap,
    surface: Surface,
    center: Float[Array, "3"],
    scale: float,
    samples: int,
    rng: np.random.Generator,
    threads: int,
) -> Distance | None:
    if surface.sample is None:
        return None
    points = (surface.sample(samples, rng)[0] - center) / scale
    closest = TriangleBVH(dense.vertices, dense.triangles).closest(points, threads)[0]
    return _statistics(np.linalg.norm(points - closest, axis=1))


def _statistics(distance: Float[Array, " n"]) -> Distance:
    """Statistics of box-frame distances, as shares of the longest side, which is 3 there."""
    if not len(distance):
        return Distance(np.inf, np.inf, np.inf, np.inf)
    share = distance / 3.0
    return Distance(
        rms=float(np.sqrt((share**2).mean())),
        mean=float(share.mean()),
        p99=float(np.quantile(share, 0.99)),
        max=float(share.max()),
    )
