"""Points spread over the mapped surface, straight from the asset: white noise and blue noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_core.asset.asset import Asset
from ndf_core.asset.pushforward import mapped_points
from ndf_core.errors import ConfigError, InputError

_CHUNK = 16_384
_PROBES = 16_384
_MARGIN = 1.5
"""The largest |det J| anywhere is taken to be at most so many times the largest of the probes."""
_MOST = 20_000_000
_PER_DISK = 12
"""Candidates per point of blue noise in the first round."""
_ROUNDS = 6
_PACKING = 0.65
"""Points of a maximal Poisson-disk pattern, times radius squared, over area; measured."""


@dataclass(frozen=True)
class SurfaceSamples:
    """Points of the mapped surface."""

    points: Float[Array, "n 3"]
    """Input units."""
    normals: Float[Array, "n 3"]
    base_faces: Int[Array, " n"]
    barycentric: Float[Array, "n 3"]
    radius: float
    """No two points are closer, input units; 0 for white noise."""


def white_noise(asset: Asset, count: int, seed: int = 0) -> SurfaceSamples:
    """Independent points, uniform by area on the mapped surface.

    Points uniform on the base mesh are accepted with a probability proportional to |det J| (Sec. 5.2, fig:sampling).

    Raises:
        ConfigError: a count that is not from 1 to 20 million.
        InputError: the field has no area.
    """
    if not 1 <= count <= _MOST:
        raise ConfigError(f"{count} samples: ask for 1 to {_MOST:,}")
    sampler = _Sampler(asset, np.random.default_rng(seed))
    parts: list[_Part] = []
    while (found := sum(len(part[0]) for part in parts)) < count:
        parts.append(sampler.draw(min(4 * (count - found) + 1024, 16 * _CHUNK)))
    joined = [np.concatenate(column)[:count] for column in zip(*parts, strict=True)]
    return _samples(asset, joined, 0.0)


def blue_noise(asset: Asset, radius: float, seed: int = 0) -> SurfaceSamples:
    """Points at least `radius` apart that leave hardly room for another one (Poisson disks).

    Distances are straight lines between the mapped points, so the two sides of a sheet thinner than the radius
    exclude each other. Candidates are white noise in random order; each is taken unless it is too close to one before
    it. The same is done again in the gaps that are left.

    Raises:
        ConfigError: a radius that is not positive, or so small that millions of points would be needed.
        InputError: the field has no area.

    Reference: Sec. 5.2; Bridson 2007, with the radius measured on the mapped surface.
    """
    if not 0 < radius < np.inf:
        raise ConfigError(f"the radius of blue noise is {radius:g}: must be positive")
    rng = np.random.default_rng(seed)
    sampler = _Sampler(asset, rng)
    scale = asset.content.scale
    expected = _PACKING * sampler.area * scale**2 / radius**2
    if expected * _PER_DISK > _MOST:
        raise ConfigError(f"blue noise of radius {radius:g} would have about {expected:,.0f} points: too many")
    kept: list[Array] = []
    count = int(_PER_DISK * expected) + 64
    for _ in range(_ROUNDS):
        parts: list[_Part] = []
        while sum(len(part[0]) for part in parts) < count:
            parts.append(sampler.draw(16 * _CHUNK if count > 4 * _CHUNK else 4 * count))
        candidates = [np.concatenate(column)[:count] for column in zip(*parts, strict=True)]
        points = candidates[2] * scale
        free = np.ones(len(points), dtype=bool)
        if kept:
            free = KDTree(kept[2] * scale).query(points, distance_upper_bound=radius)[0] >= radius
        candidates = [column[free] for column in candidates]
        taken = _greedy(candidates[2] * scale, radius)
        chosen = [column[taken] for column in candidates]
        kept = [np.concatenate(pair) for pair in zip(kept, chosen, strict=True)] if kept else chosen
    return _samples(asset, kept, radius)


def radius_for(asset: Asset, count: int) -> float:
    """The radius at which blue noise has about `count` points.

    Raises:
        ConfigError: a count that is not positive.
    """
    if count < 1:
        raise ConfigError(f"{count} samples: ask for at least 1")
    area = _Sampler(asset, np.random.default_rng(0)).area * asset.content.scale**2
    return float(np.sqrt(_PACKING * area / count))


def _greedy(points: Float[Array, "n 3"], radius: float) -> Bool[Array, " n"]:
    """Those that would be taken one after the other: none closer than `radius` to one taken before.

    All whose undecided neighbours come later are taken at once, and their neighbours are out; again until all are
    decided.
    """
    pairs = KDTree(points).query_pairs(radius, output_type="ndarray")
    first, second = pairs.min(axis=1), pairs.max(axis=1)
    taken, decided = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool)
    while not decided.all():
        waits = np.zeros(len(points), dtype=bool)
        waits[second] = True
        fresh = ~waits & ~decided
        taken |= fresh
        decided |= fresh
        decided[second[taken[first]]] = True
        left = ~decided[first] & ~decided[second]
        first, second = first[left], second[left]
    return taken


_Part = tuple[Array, Array, Array, Array]
"""Base faces, barycentric weights, points and normals, box frame."""


class _Sampler:
    """White noise in portions."""

    def __init__(self, asset: Asset, rng: np.random.Generator) -> None:
        self._content, self._rng = asset.content, rng
        corners = self._content.placed[self._content.faces]
        base = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        self._ends = np.cumsum(base)
        ratio = mapped_points(self._content, *self._uniform(_PROBES)).area_ratio
        if not (np.isfinite(ratio).all() and ratio.any()):
            raise InputError("the asset's surface has no area, or is not finite: the asset is damaged")
        self.area = float(ratio.mean() * self._ends[-1])
        """Of the mapped surface, estimated; box frame."""
        self._ceiling = _MARGIN * float(ratio.max())

    def draw(self, candidates: int) -> _Part:
        """What is accepted of so many candidates."""
        parts: list[_Part] = []
        for start in range(0, candidates, _CHUNK):
            faces, barycentric = self._uniform(min(_CHUNK, candidates - start))
            mapped = mapped_points(self._content, faces, barycentric)
            keep = self._rng.random(len(faces)) * self._ceiling < mapped.area_ratio
            parts.append((faces[keep], barycentric[keep], mapped.points[keep], mapped.normals[keep]))
        faces, barycentric, points, normals = (np.concatenate(column) for column in zip(*parts, strict=True))
        return faces, barycentric, points, normals

    def _uniform(self, count: int) -> tuple[Int[Array, " n"], Float[Array, "n 3"]]:
        """On the base mesh, by area."""
        place = np.searchsorted(self._ends, self._rng.random(count) * self._ends[-1])
        root, along = np.sqrt(self._rng.random(count)), self._rng.random(count)
        barycentric = np.stack([1 - root, root * (1 - along), root * along], axis=1)
        return np.minimum(place, len(self._ends) - 1).astype(np.int32), barycentric


def _samples(asset: Asset, columns: list[Array], radius: float) -> SurfaceSamples:
    faces, barycentric, points, normals = columns
    return SurfaceSamples(asset.to_input(points), normals, faces, barycentric, radius)
