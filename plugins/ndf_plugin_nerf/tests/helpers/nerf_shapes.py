"""Densities with closed forms, and networks with random weights beside an independent forward pass."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from ndf_plugin_nerf.function import FunctionDensity
from numpy import ndarray as Array

from ndf_core.surfaces.box import Box

THRESHOLD = 20.0
STEEPNESS = 200.0
"""Of every density at its surface, per unit of length."""


def solid(distance: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """A density that is THRESHOLD where `distance` (negative inside) is zero, and nowhere above ten times that."""
    return lambda points: np.clip(THRESHOLD - STEEPNESS * distance(points), -10 * THRESHOLD, 10 * THRESHOLD)


def ball(center: tuple[float, float, float] = (0.0, 0.0, 0.0), radius: float = 1.0) -> Callable[[Array], Array]:
    """Signed distance of a ball."""
    return lambda points: np.linalg.norm(points - np.array(center), axis=1) - radius


def shell(inner: float, outer: float) -> Callable[[Array], Array]:
    """Signed distance of a hollow ball."""
    middle, half = (inner + outer) / 2, (outer - inner) / 2
    return lambda points: np.abs(np.linalg.norm(points, axis=1) - middle) - half


def union(*distances: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda points: np.min([distance(points) for distance in distances], axis=0)


def density(distance: Callable[[Array], Array], half_side: float = 1.5) -> FunctionDensity:
    """The solid in a cube about the origin."""
    return FunctionDensity("solid", solid(distance), Box(np.full(3, -half_side), np.full(3, half_side)))


def random_network(family: str, seed: int, octaves: int = 3, width: int = 8, depth: int = 6) -> dict[str, Array]:
    """Arrays of a network of a family, with a skip connection where its authors put one."""
    rng = np.random.default_rng(seed)
    encoded = 3 + 6 * octaves

    def layer(name: str, out: int, into: int) -> dict[str, Array]:
        return {
            f"{name}.weight": (rng.standard_normal((out, into)) / into**0.5).astype(np.float32),
            f"{name}.bias": rng.standard_normal(out).astype(np.float32),
        }

    arrays: dict[str, Array] = {}
    if family == "FlexibleNeRFModel":
        arrays |= layer("layer1", width, encoded)
        for i in range(depth - 1):
            arrays |= layer(f"layers_xyz.{i}", width, width + (encoded if i == 4 else 0))
        arrays |= layer("fc_alpha", 1, width) | layer("fc_rgb", 3, width) | layer("fc_feat", width, width)
    elif family == "nerf-pytorch":
        for i in range(depth):
            arrays |= layer(f"pts_linears.{i}", width, encoded if i == 0 else width + (encoded if i == 5 else 0))
        arrays |= layer("views_linears.0", width, width + 27) | layer("alpha_linear", 1, width)
    else:
        for i in range(1, depth + 1):
            into = encoded if i == 1 else width + (encoded if i == 5 else 0)
            arrays |= layer(f"xyz_encoding_{i}.0", width, into)
        arrays |= layer("xyz_encoding_final", width, width) | layer("sigma", 1, width)
    return arrays


def reference_density(family: str, arrays: dict[str, Array], points: Array, octaves: int = 3) -> Array:
    """The forward pass as the family's authors write it, in float64 and one point after another's column."""
    parts = [points]
    for octave in range(octaves):
        parts += [np.sin(points * 2.0**octave), np.cos(points * 2.0**octave)]
    encoded = np.concatenate(parts, axis=1)

    def linear(name: str, x: Array) -> Array:
        return x @ arrays[f"{name}.weight"].T.astype(np.float64) + arrays[f"{name}.bias"]

    hidden = encoded
    if family == "FlexibleNeRFModel":
        hidden = linear("layer1", hidden)
        for i in range(sum(name.startswith("layers_xyz") for name in arrays) // 2):
            joined = np.concatenate([hidden, encoded], axis=1) if i == 4 else hidden
            hidden = np.maximum(linear(f"layers_xyz.{i}", joined), 0)
        return linear("fc_alpha", hidden)[:, 0]
    if family == "nerf-pytorch":
        for i in range(sum(name.startswith("pts_linears") for name in arrays) // 2):
            joined = np.concatenate([encoded, hidden], axis=1) if i == 5 else hidden
            hidden = np.maximum(linear(f"pts_linears.{i}", joined), 0)
        return linear("alpha_linear", hidden)[:, 0]
    for i in range(1, sum(name.startswith("xyz_encoding") for name in arrays) // 2):
        joined = np.concatenate([encoded, hidden], axis=1) if i == 5 else hidden
        hidden = np.maximum(linear(f"xyz_encoding_{i}.0", joined), 0)
    return linear("sigma", hidden)[:, 0]
