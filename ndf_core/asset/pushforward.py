"""The mapped surface to first order at points of the base mesh, without torch (Sec. 3.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.asset.content import AssetContent, values_of


class MappedPoints(NamedTuple):
    """Where base points go, box frame."""

    points: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    """n_theta: J t1 x J t2 over its length; outwards where the map does not fold."""
    area_ratio: Float[Array, " n"]
    """|det J|: mapped area per area of the base mesh."""


def mapped_points(content: AssetContent, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> MappedPoints:
    """g, its normal and |det J| at base points; float64.

    Value and derivative along two edges of the face go through the network side by side; a ReLU passes a derivative
    where it passes the value. The features' share of J, through the barycentric weights, is in it.
    """
    block = content.fields["displacement"]
    corners = content.faces[faces]
    triangles = content.placed[corners]
    positions = np.einsum("nc,ncx->nx", barycentric, triangles)
    edges = triangles[:, 1:] - triangles[:, :1]
    table = values_of(block.features).astype(np.float64)[corners]
    features = np.einsum("nc,ncd->nd", barycentric, table)
    feature_rates = table[:, 1:] - table[:, :1]
    encoding = block.encoding
    value, rate = [positions] if encoding.include_position else [], [edges] if encoding.include_position else []
    for level in range(encoding.levels):
        frequency = encoding.base_frequency * 2.0**level
        sine, cosine = np.sin(frequency * positions), np.cos(frequency * positions)
        value += [sine, cosine]
        rate += [frequency * cosine[:, None] * edges, -frequency * sine[:, None] * edges]
    now, moved = np.concatenate([*value, features], axis=1), np.concatenate([*rate, feature_rates], axis=2)
    for i, (weights, biases) in enumerate(zip(block.weights, block.biases, strict=True)):
        matrix = values_of(weights).astype(np.float64)
        now, moved = now @ matrix.T + values_of(biases), moved @ matrix.T
        if i + 1 < len(block.weights):
            moved *= (now > 0)[:, None]
            now = np.maximum(now, 0.0)
    columns = moved + edges if block.residual else moved
    area = np.cross(columns[:, 0], columns[:, 1])
    size = np.linalg.norm(area, axis=1)
    base = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    ratio = np.divide(size, base, out=np.zeros_like(size), where=base > 0)
    normals = area / np.maximum(size, 1e-300)[:, None]
    return MappedPoints(now + positions if block.residual else now, normals, ratio)
