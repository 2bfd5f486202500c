"""A sheet of splats that was seen from one side only, such as the floor of a scene, becomes a slab."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_core.base_mesh.thickness import thickness
from ndf_plugin_gaussians.layer import Boundary, Layer

_THIN = 2.5
"""The solid is a sheet where it is thinner than so many of its depths: its skin alone has two."""
_LEAST = 0.3
"""Share of its boundary that is thin, from which on there is a sheet."""
_FLAT = 0.8
"""Mean square of the cosine between the normals of a sheet and its axis, at least."""
_FACING = 0.7
"""Cosine from which on a point's normal belongs to the sheet's faces and not to its rim."""


@dataclass(frozen=True)
class Slab:
    """What a sheet becomes."""

    axis: Float[Array, "3"]
    """Unit vector to the side that was seen."""
    thickness: float
    share: float
    """Of the solid's boundary."""
    sheet: Float[Array, "n 3"]
    """Vertices of the boundary around it ..."""
    rest: Float[Array, "m 3"]
    """... and elsewhere."""

    def note(self) -> str:
        x, y, z = self.axis
        return (
            f"{self.share:.0%} of the surface is a sheet without thickness; taken as seen from ({x:.2f}, {y:.2f}, "
            f"{z:.2f}), where the rest lies, and made {self.thickness:.3g} thick behind that side (--no-thicken)"
        )


def find_slab(boundary: Boundary, depth: float, opaque: Float[Array, "k 3"], thick: float) -> Slab | None:
    """The flat sheet that a good part of a solid consists of; None where there is none.

    A floor was seen from where things stand on it: the side of the plane on which the opaque centres lie that are
    farther from it than the skin is deep.

    Args:
        boundary: of the solid.
        depth: of the visible splats below it.
        opaque: centres of opaque splats.
        thick: thickness to give it.
    """
    thin = thickness(boundary.vertices, boundary.faces) <= _THIN * depth
    share = float(thin.mean())
    if share < _LEAST:
        return None
    normals = boundary.normals[thin]
    spread, axes = np.linalg.eigh(normals.T @ normals / len(normals))
    if spread[2] < _FLAT:
        return None
    axis = axes[:, 2]
    height = (opaque - np.median(boundary.vertices[thin], axis=0)) @ axis
    beyond = height[np.abs(height) > _THIN * depth]
    if (beyond > 0).sum() < (beyond < 0).sum():
        axis = -axis
    return Slab(axis, thick, share, boundary.vertices[thin], boundary.vertices[~thin])


def with_slab(layer: Layer, slab: Slab) -> Layer:
    """The layer, in which all points of the sheet face the seen side, and the same farther back the other one."""
    cosine = layer.normals @ slab.axis
    within = KDTree(slab.sheet).query(layer.points)[0]
    elsewhere = KDTree(slab.rest).query(layer.points)[0] if len(slab.rest) else np.full(len(within), np.inf)
    sheet = (within <= elsewhere) & (np.abs(cosine) >= _FACING)
    normals = np.where(sheet & (cosine < 0), -1.0, 1.0)[:, None] * layer.normals
    return replace(
        layer,
        points=np.concatenate([layer.points, layer.points[sheet] - slab.thickness * slab.axis]),
        normals=np.concatenate([normals, -normals[sheet]]),
        weights=np.concatenate([layer.weights, layer.weights[sheet]]),
        detail=np.concatenate([layer.detail, layer.detail[sheet]]),
        thinnest=slab.thickness,
    )
