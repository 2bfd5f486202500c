"""Base points with the values that a field is to have there: what a field's network is trained with (Sec. 3.5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree
from torch import Tensor

from ndf_core.asset.asset import Asset
from ndf_core.asset.dense_map import dense_map, even_samples
from ndf_core.errors import InputError
from ndf_core.fitting.field_values import CheckedValues
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.sampling import BasePoints
from ndf_core.kernels.bvh import TriangleBVH

_TRIANGLES = 200_000
"""Of the mesh that even samples are drawn on."""
_FAR = 0.05
"""Values farther from the surface than this share of the longest side belong to something else."""
_FILLED = 3.0
"""Surface farther from all points than so many times their typical distance takes the value of the closest one."""
_FILLING = 0.25
"""Even samples that look for such surface, per point."""


@dataclass(frozen=True)
class FieldSamples:
    """Base points in order of their faces, with targets. Rows are independent draws, so any of them make a batch."""

    faces: Int[Tensor, " n"]
    barycentric: Float[Tensor, "n 3"]
    targets: Float[Tensor, "n k o"]
    largest_offset: float
    """Largest distance between a base point's image and where its value was found, input units."""
    left_out: int
    """Points with values that are not near the surface."""
    invented: float
    """Share of the samples on surface without a value near it."""

    def __len__(self) -> int:
        return len(self.faces)

    def to(self, device: torch.device | str) -> FieldSamples:
        """The same on a device."""
        return replace(
            self,
            faces=self.faces.to(device),
            barycentric=self.barycentric.to(device),
            targets=self.targets.to(device),
        )

    def batch(
        self, geometry: BaseGeometry, count: int, generator: torch.Generator
    ) -> tuple[BasePoints, Float[Tensor, "k b o"]]:
        """`count` rows with even gaps from a random one on, so that they are spread over the whole surface."""
        ticks = (torch.arange(count) + torch.rand(1, generator=generator, dtype=torch.float64)) / count
        rows = (ticks * len(self)).long().clamp_(max=len(self) - 1)
        if count < len(self):
            rows = (rows + torch.randint(len(self), (1,), generator=generator)) % len(self)
            rows = rows.sort().values
        return self.rows(geometry, rows.to(self.faces.device))

    def rows(self, geometry: BaseGeometry, rows: Int[Tensor, " b"]) -> tuple[BasePoints, Float[Tensor, "k b o"]]:
        """Some of the rows: base points, and targets by field."""
        base = BasePoints(geometry, self.faces[rows], self.barycentric[rows])
        return base, self.targets[rows].transpose(0, 1)


def sample_values(
    asset: Asset, values: CheckedValues, kind: str, count: int, seed: int, threads: int
) -> FieldSamples:
    """Samples of values on a mesh, `count` of them, even over the mapped surface; or every value given at points.

    Raises:
        InputError: no value lies near the asset's surface.
    """
    if values.faces is not None:
        return _on_mesh(asset, values, kind, count, seed, threads)
    return _at_points(asset, values, seed, threads)


def _even(asset: Asset, count: int, seed: int) -> tuple[Int[Array, " n"], Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Base points even by area on the mapped surface, and where they are mapped, input units."""
    dense = dense_map(len(asset.content.faces), asset.evaluate, _TRIANGLES)
    faces, barycentric, _ = even_samples(dense, count, np.random.default_rng(seed))
    return faces, barycentric, asset.map_points(faces, barycentric)


def _on_mesh(asset: Asset, values: CheckedValues, kind: str, count: int, seed: int, threads: int) -> FieldSamples:
    assert values.faces is not None
    faces, barycentric, mapped = _even(asset, count, seed)
    near, triangles, weights = TriangleBVH(values.points, values.faces).closest(mapped, threads)
    offsets = np.linalg.norm(near - mapped, axis=1)
    if np.median(offsets) > _FAR * asset.longest_side:
        raise _elsewhere(asset, offsets)
    targets = values.at(triangles, weights, kind == "continuous")
    return _sorted(faces, barycentric, targets, float(offsets.max()))


def _at_points(asset: Asset, values: CheckedValues, seed: int, threads: int) -> FieldSamples:
    faces, barycentric, offsets = asset.locate(values.points, threads)
    near = offsets <= _FAR * asset.longest_side
    if not near.any():
        raise _elsewhere(asset, offsets)
    faces, barycentric, targets = faces[near], barycentric[near], values.targets[near]
    more_faces, more_barycentric, mapped = _even(asset, int(_FILLING * len(faces)) + 1000, seed)
    distance, closest = (np.asarray(part) for part in KDTree(values.points[near]).query(mapped))
    # The points' own distances from the surface count in, or a noisy cloud would seem to have gaps everywhere.
    gap = distance > _FILLED * float(np.median(distance))
    return _sorted(
        np.concatenate([faces, more_faces[gap]]),
        np.concatenate([barycentric, more_barycentric[gap]]),
        np.concatenate([targets, targets[closest[gap]]]),
        float(offsets[near].max()),
        int((~near).sum()),
        float(gap.mean()),
    )


def _sorted(
    faces: Int[Array, " n"],
    barycentric: Float[Array, "n 3"],
    targets: Float[Array, "n k o"],
    largest_offset: float,
    left_out: int = 0,
    invented: float = 0.0,
) -> FieldSamples:
    """By face, which keeps the gather of features in cache and spreads a batch with even gaps over the surface."""
    order = np.argsort(faces, kind="stable")
    return FieldSamples(
        torch.from_numpy(faces[order].astype(np.int64)),
        torch.from_numpy(barycentric[order]).float(),
        torch.from_numpy(targets[order]).float(),
        largest_offset,
        left_out,
        invented,
    )


def _elsewhere(asset: Asset, offsets: Float[Array, " n"]) -> InputError:
    return InputError(
        f"field values: their median distance from the asset's surface is {float(np.median(offsets)):.3g}, and its "
        f"longest side {asset.longest_side:.3g}: another shape, or in other units than the input that was fitted"
    )
