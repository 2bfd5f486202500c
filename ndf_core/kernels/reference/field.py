"""The field network in plain numpy, float64 throughout: what `kernels.field` is compared with."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.field import FieldArrays


def encode(
    points: Float[Array, "n 3"], base_frequency: float, levels: int, include_position: bool
) -> Float[Array, "n e"]:
    """[x], then for each level k the sines and cosines of 2^k * base_frequency * x (Sec. 3.3), float64."""
    columns = [points] if include_position else []
    for level in range(levels):
        angle = 2.0**level * base_frequency * points
        columns += [np.sin(angle), np.cos(angle)]
    return np.concatenate(columns, axis=1) if columns else np.zeros((len(points), 0))


def apply_network(
    field: FieldArrays, points: Float[Array, "n 3"], features: Float[Array, "n d"]
) -> Float[Array, "n k"]:
    """Dense layers with ReLU between them, and x added where the field is a residual; float64."""
    encoded = encode(points, field.base_frequency, field.levels, field.include_position)
    current = np.concatenate([encoded, features], axis=1)
    parameters = field.parameters.astype(np.float64)
    position = 0
    layers = len(field.widths) - 1
    for layer, (inputs, outputs) in enumerate(zip(field.widths[:-1], field.widths[1:], strict=True)):
        weights = parameters[position : position + inputs * outputs].reshape(outputs, inputs)
        biases = parameters[position + inputs * outputs :][:outputs]
        position += (inputs + 1) * outputs
        current = current @ weights.T + biases
        if layer + 1 < layers:
            current = np.maximum(current, 0.0)
    return current + points if field.residual else current


def evaluate_field(
    field: FieldArrays,
    faces: Int[Array, " n"],
    barycentric: Float[Array, "n 3"],
    vertices: Float[Array, "v 3"],
    base_faces: Int[Array, "f 3"],
) -> Float[Array, "n k"]:
    """The field at points of the base mesh."""
    corners = base_faces[faces]
    points = np.einsum("nk,nkc->nc", barycentric, vertices[corners])
    features = np.einsum("nk,nkd->nd", barycentric, field.features[corners].astype(np.float64))
    return apply_network(field, points, features)


def evaluate_space_field(field: FieldArrays, points: Float[Array, "n 3"]) -> Float[Array, "n k"]:
    """The field at points of the box frame."""
    return apply_network(field, points, np.zeros((len(points), 0)))
