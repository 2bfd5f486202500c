"""The outer level set of a density: hollows filled, floaters gone, as a function that is negative inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from ndf_core.interfaces import Remark
from ndf_core.surfaces.box import Box
from ndf_plugin_nerf.density import Density
from ndf_plugin_nerf.lattice import Nodes, Trilinear
from ndf_plugin_nerf.outside import flooded, parts_of
from ndf_plugin_nerf.sampled import sample_near

CLIP = 10.0
"""Differences of the density from the threshold are cut at so many thresholds: NeRFs reach thousands of them."""


@dataclass(frozen=True)
class OuterField:
    """threshold - density at the nodes of a grid, in thresholds, cut at +-CLIP; negative inside.

    Nodes that a flood from outside does not reach count as inside, whatever their density: inside of things a NeRF is
    hollow and noisy, since no camera saw it. Parts too small to keep count as outside.
    """

    nodes: Nodes
    values: Float[Array, "x y z"]
    threshold: float
    asked: int
    """Points at which the density was evaluated."""
    remarks: tuple[Remark, ...]

    @classmethod
    def of(cls, density: Density, box: Box, threshold: float, resolution: int, least_part: float) -> OuterField:
        """Sample the density and flood the space around it.

        Args:
            density: what to sample.
            box: where; what reaches its sides is closed there.
            threshold: density of the surface.
            resolution: cells along the longest side.
            least_part: parts with a smaller share of the largest one's volume are left out.
        """
        nodes = Nodes.over(box, resolution)
        found, asked = sample_near(density, nodes, threshold)
        parts = parts_of(~flooded(found < threshold))
        kept = parts.of_share(least_part)
        values = np.clip(1.0 - found / threshold, -CLIP, CLIP)
        inside = (parts.label > 0) & (parts.label <= kept)
        # A node exactly at the threshold is inside, which zero would not be.
        values[inside] = np.where(found[inside] >= threshold, np.minimum(values[inside], -1e-6), -1.0)
        values[parts.label > kept] = 1.0
        return cls(nodes, values, threshold, asked, _dropped(kept, len(parts.sizes), parts.sizes, nodes))

    @property
    def inside(self) -> Bool[Array, "x y z"]:
        return self.values < 0

    def function(self) -> Trilinear:
        return Trilinear(self.nodes, self.values, beyond=CLIP)


def _dropped(kept: int, count: int, sizes: Array, nodes: Nodes) -> tuple[Remark, ...]:
    if kept == count:
        return ()
    share = float(sizes[kept:].sum() / sizes.sum())
    message = f"{count - kept} floating parts left out, {100 * share:.2g}% of the volume; {kept} kept"
    size = float(np.prod(nodes.step) * sizes[kept]) ** (1 / 3)
    return (Remark("dropped_component", message, size=size, count=count - kept),)
