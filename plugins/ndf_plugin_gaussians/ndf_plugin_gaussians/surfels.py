"""Splats cut into small pieces of surface, so that a large splat counts everywhere where it is seen."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_plugin_gaussians.splats import Splats

MOST_PIECES = 20_000_000


@dataclass(frozen=True)
class Surfels:
    """Pieces of the splats' discs: the plane of the two longer axes, up to where the opacity falls below a limit."""

    points: Float[Array, "m 3"]
    normals: Float[Array, "m 3"]
    """Unit vectors along the shortest axis; the sign means nothing at first."""
    weights: Float[Array, " m"]
    """Opacity of the splat at the point, between 0 and 1."""
    areas: Float[Array, " m"]

    def take(self, rows: Int[Array, " k"] | Bool[Array, " m"]) -> Surfels:
        return Surfels(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


def cut(splats: Splats, spacing: float, min_opacity: float) -> Surfels:
    """Cut every splat into pieces at most `spacing` wide.

    A splat of opacity a is seen up to r standard deviations, where a exp(-r^2 / 2) = `min_opacity`. Pieces lie on a
    grid in its disc; a splat smaller than `spacing` is one piece with the area of its disc.

    Args:
        splats: all at least `min_opacity` opaque.
        spacing: in input units; made larger where the pieces would be more than some millions.
        min_opacity: where a splat ends.
    """
    order = np.argsort(-splats.scales, axis=1, kind="stable")
    scales = np.take_along_axis(splats.scales, order, axis=1)
    axes = np.take_along_axis(splats.frames(), order[:, None, :], axis=2)
    reach = np.sqrt(2.0 * np.log(np.maximum(splats.opacities / min_opacity, 1.0)))
    radii = reach[:, None] * scales[:, :2]
    while True:
        across = np.maximum(1, np.ceil(2.0 * radii / spacing))
        if across.prod(axis=1).sum() <= MOST_PIECES:
            break
        spacing *= 1.5
    across = across.astype(np.int64)
    count = across.prod(axis=1)
    owner = np.repeat(np.arange(len(count)), count)
    row, column = np.divmod(np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count), across[owner, 1])
    # Coordinates in the disc, between -1 and 1; pieces in the corners of its square are not seen.
    place = (np.stack([row, column], axis=1) + 0.5) / across[owner] * 2.0 - 1.0
    seen = (place**2).sum(axis=1) <= 1.0
    owner, place = owner[seen], place[seen]
    offset = (axes[owner, :, :2] * (radii[owner] * place)[:, None, :]).sum(axis=2)
    whole = np.where(count == 1, np.pi, 4.0)  # one piece is the disc, others are rectangles
    return Surfels(
        points=splats.centres[owner] + offset,
        normals=axes[owner, :, 2],
        weights=splats.opacities[owner] * np.exp(-0.5 * (reach[owner] ** 2) * (place**2).sum(axis=1)),
        areas=(whole * radii.prod(axis=1) / count)[owner],
    )
