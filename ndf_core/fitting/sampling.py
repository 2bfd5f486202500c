"""Base points for training, drawn evenly over the mapped surface; each draw is a function of (seed, step) alone."""

from __future__ import annotations

import copy

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import FitError
from ndf_core.fitting.geometry import BaseGeometry, area_ratio
from ndf_core.fitting.network import Parameters, displace, interpolate
from ndf_core.fitting.step import Batch

_GOLDEN = 0x9E3779B97F4A7C15
_CANDIDATES = 8192


def generator_at(seed: int, step: int) -> torch.Generator:
    """A generator whose stream depends on (seed, step) alone, so that a resumed run draws what the first one drew."""
    mixed = (seed * _GOLDEN + step + 1) % 2**64
    mixed = ((mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
    mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) % 2**64
    return torch.Generator().manual_seed((mixed ^ (mixed >> 31)) % 2**63)


class BasePoints:
    """Faces and barycentric weights of a batch."""

    def __init__(self, geometry: BaseGeometry, face: Int[Tensor, " n"], barycentric: Float[Tensor, "n 3"]) -> None:
        self.face = face
        self.barycentric = barycentric
        self.weight: Float[Tensor, " n"] | None = None
        """How much each point counts in a mean over the mapped surface; None where all count the same."""
        self.batch = Batch(geometry.faces[face], barycentric, geometry.positions(face, barycentric))

    def rows(self, start: int, end: int) -> BasePoints:
        """Some of the rows, as views."""
        if start == 0 and end >= len(self.face):
            return self
        part = copy.copy(self)
        part.face, part.barycentric = self.face[start:end], self.barycentric[start:end]
        part.weight = None if self.weight is None else self.weight[start:end]
        part.batch = Batch(*(tensor[start:end] for tensor in self.batch))
        return part


def base_points_at(geometry: BaseGeometry, face: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> BasePoints:
    """Base points given as numpy arrays, on the geometry's device."""
    device = geometry.device
    return BasePoints(
        geometry,
        torch.from_numpy(face.astype(np.int64)).to(device),
        torch.from_numpy(barycentric).float().to(device),
    )


def joined(*parts: BasePoints) -> BasePoints:
    """The rows of all parts, in order."""
    parts = tuple(part for part in parts if len(part.face)) or parts[:1]
    if len(parts) == 1:
        return parts[0]
    whole = copy.copy(parts[0])
    whole.face = torch.cat([part.face for part in parts])
    whole.barycentric = torch.cat([part.barycentric for part in parts])
    whole.batch = Batch(*(torch.cat(tensors) for tensors in zip(*(part.batch for part in parts), strict=True)))
    if any(part.weight is not None for part in parts):
        ones = [torch.ones_like(part.barycentric[:, 0]) if part.weight is None else part.weight for part in parts]
        whole.weight = torch.cat(ones)
    return whole


def stratified(
    geometry: BaseGeometry,
    areas: Float[Tensor, " f"],
    count: int,
    generator: torch.Generator,
    density: Float[Tensor, " f"] | None = None,
) -> BasePoints:
    """`count` base points; a face gets the floor or the ceiling of its share of `areas` (systematic sampling).

    Where `density` is given, faces are sampled that much more densely, and their points weigh so much less.

    One random offset for all ticks makes that so; with one for each, a face could miss its share by almost two. The
    points come sorted by face, which keeps the gather of vertex features in cache.
    """
    cumulative = torch.cumsum((areas if density is None else areas * density).double().cpu(), 0)
    ticks = (torch.arange(count) + torch.rand(1, generator=generator, dtype=torch.float64)) / count
    face = torch.searchsorted(cumulative, ticks * cumulative[-1]).clamp_max(len(areas) - 1).to(geometry.device)
    base = BasePoints(geometry, face, _barycentric(count, generator).to(geometry.device))
    base.weight = None if density is None else 1 / density[face]
    return base


def by_rejection(
    geometry: BaseGeometry, parameters: Parameters, count: int, generator: torch.Generator
) -> BasePoints:
    """`count` base points with density proportional to |det J_f|, by rejection from the uniform density.

    Raises:
        FitError: the mapped surface has no area, or is not finite.

    Reference: Sec. 3.2 (the loss is an integral over the mapped surface).
    """
    faces: list[Tensor] = []
    weights: list[Tensor] = []
    found, ceiling = 0, 0.0
    areas = geometry.areas.cpu()
    while found < count:
        face = torch.multinomial(areas, _CANDIDATES, replacement=True, generator=generator).sort().values
        face, barycentric = face.to(geometry.device), _barycentric(_CANDIDATES, generator).to(geometry.device)
        ratio = area_ratio(parameters, geometry, face, barycentric)
        if not ceiling:
            # Over the 99th percentile the density is cut off: one wild spot would otherwise reject everything else.
            ceiling = float(ratio.quantile(0.99).clamp_min(1e-30))
        keep = torch.rand(_CANDIDATES, generator=generator).to(ratio.device) * ceiling < ratio
        if not keep.any():  # and never will be
            raise FitError(
                "no sample can be drawn: the mapped surface has no area or is not finite; lower --learning-rate"
            )
        faces.append(face[keep])
        weights.append(barycentric[keep])
        found += int(keep.sum())
    # Candidates come sorted within a round: take an even share of each, not the first faces of the last.
    face, barycentric = torch.cat(faces), torch.cat(weights)
    chosen = torch.randperm(found, generator=generator)[:count].to(geometry.device)
    chosen = chosen[torch.argsort(face[chosen], stable=True)]
    return BasePoints(geometry, face[chosen], barycentric[chosen])


def mapped_areas(geometry: BaseGeometry, parameters: Parameters) -> Float[Tensor, " f"]:
    """Area of every face on the mapped surface (box frame), from its four midpoint triangles."""
    mids = torch.tensor(
        [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]], device=geometry.device
    )
    count = len(geometry.faces)
    face = torch.arange(count, device=geometry.device).repeat_interleave(6)
    barycentric = mids.repeat(count, 1)
    features = interpolate(parameters.features, geometry.faces[face], barycentric)
    mapped = displace(parameters, geometry.positions(face, barycentric), features).view(count, 6, 3)
    small = mapped[:, torch.tensor([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])]
    sides = small[:, :, 1:] - small[:, :, :1]
    return torch.linalg.vector_norm(torch.linalg.cross(sides[:, :, 0], sides[:, :, 1]), dim=-1).sum(1) / 2


def _barycentric(count: int, generator: torch.Generator) -> Float[Tensor, "n 3"]:
    """Uniform points of the triangle: a square root turns two uniform numbers into barycentric weights."""
    root = torch.rand(count, generator=generator).sqrt_()
    along = torch.rand(count, generator=generator)
    return torch.stack([1 - root, root * (1 - along), root * along], dim=1)
