"""Small assets made by hand: a base mesh through the real codec, and a network of known or random weights."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.asset.base_mesh_codec import decode_base_mesh, encode_integer_mesh
from ndf_core.asset.content import AssetContent, Encoding, FieldBlock, QuantisedArray, Stored

Mesh = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]


def icosphere(subdivisions: int = 1) -> Mesh:
    """Closed unit sphere, genus 0, counter-clockwise from outside."""
    golden = (1 + 5**0.5) / 2
    vertices = [(a, b * golden, 0.0) for b in (1, -1) for a in (-1.0, 1.0)]
    vertices += [(0.0, a, b * golden) for b in (1, -1) for a in (-1.0, 1.0)]
    vertices += [(a * golden, 0.0, b) for a in (1, -1) for b in (-1.0, 1.0)]
    points = [np.array(vertex) / np.linalg.norm(vertex) for vertex in vertices]
    faces = [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
        (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
        (8, 6, 7), (9, 8, 1),
    ]  # fmt: skip
    for _ in range(subdivisions):
        middles: dict[tuple[int, int], int] = {}
        finer: list[tuple[int, int, int]] = []
        for a, b, c in faces:
            ab, bc, ca = (_middle(points, middles, *pair) for pair in ((a, b), (b, c), (c, a)))
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = finer
    return np.array(points), np.array(faces, dtype=np.int32)


def _middle(points: list[Array], middles: dict[tuple[int, int], int], a: int, b: int) -> int:
    key = (min(a, b), max(a, b))
    if key not in middles:
        middle = points[a] + points[b]
        middles[key] = len(points)
        points.append(middle / np.linalg.norm(middle))
    return middles[key]


def torus(around: int = 12, across: int = 6) -> Mesh:
    """Closed, genus 1."""
    u, v = np.meshgrid(2 * np.pi * np.arange(around) / around, 2 * np.pi * np.arange(across) / across, indexing="ij")
    radius = 1 + 0.4 * np.cos(v)
    points = np.stack([radius * np.cos(u), radius * np.sin(u), 0.4 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    k, m = (i + 1) % around, (j + 1) % across
    a, b, c, d = i * across + j, k * across + j, k * across + m, i * across + m
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def open_grid(side: int = 4) -> Mesh:
    """A wavy square with a boundary and a hole in its middle."""
    u, v = (index.ravel() for index in np.meshgrid(np.arange(side + 1), np.arange(side + 1), indexing="ij"))
    points = np.stack([u, v, np.sin(u) * np.cos(v)], axis=1).astype(np.float64) / side
    faces = []
    for i in range(side):
        for j in range(side):
            if (i, j) != (side // 2, side // 2):
                a, b = i * (side + 1) + j, (i + 1) * (side + 1) + j
                faces += [(a, b, b + 1), (a, b + 1, a + 1)]
    return points, np.array(faces, dtype=np.int32)


def small_content(
    mesh: Mesh | None = None,
    *,
    feature_dim: int = 4,
    width: int = 16,
    levels: int = 3,
    amplitude: float = 0.05,
    seed: int = 0,
    bits: int = 12,
    inverse: bool = True,
    quantised: bool = True,
    center: tuple[float, float, float] = (0.0, 0.0, 0.0),
    scale: float = 1.0,
) -> AssetContent:
    """An asset over `mesh`; random displacements of about `amplitude` in the box frame (0: the identity)."""
    points, faces = icosphere() if mesh is None else mesh
    low = points.min(axis=0)
    side = float((points.max(axis=0) - low).max())
    blob = encode_integer_mesh(np.rint((points - low) * (((1 << bits) - 1) / side)).astype(np.int64), faces, bits)
    vertices, corners = decode_base_mesh(blob, len(points), len(faces))
    rng = np.random.default_rng(seed)
    encoding = Encoding(base_frequency=float(np.float32(np.pi / 3)), levels=levels, include_position=True)

    def stored(values: Array) -> Stored:
        if not quantised:
            return values.astype(np.float32)
        step = float(np.float32(max(np.abs(values).max(initial=0.0), 1e-3) / 200))
        return QuantisedArray(np.rint(values / step).astype(np.int16), step)

    def block(name: str, kind: str, domain: str, features: Array) -> FieldBlock:
        widths = [encoding.width + features.shape[1], width, width, 3]
        last = len(widths) - 2
        weights, biases = [], []
        for i, (inputs, outputs) in enumerate(pairwise(widths)):
            size = np.sqrt(2 / inputs) * (amplitude if i == last else 1.0)
            weights.append(stored(rng.normal(size=(outputs, inputs)) * size))
            biases.append(stored(rng.normal(size=outputs) * (0.1 * amplitude if i == last else 0.1)))
        return FieldBlock(
            name, kind, domain, encoding, stored(features), tuple(weights), tuple(biases), "relu", residual=True
        )

    fields = {
        "displacement": block(
            "displacement", "displacement", "base", rng.normal(size=(len(vertices), feature_dim)) * 0.3
        )
    }
    if inverse:
        fields["inverse"] = block("inverse", "inverse", "space", np.zeros((len(vertices), 0)))
    return AssetContent(
        vertices=vertices,
        faces=corners,
        center=np.array(center, dtype=np.float64),
        scale=scale,
        fields=fields,
        provenance={"ndf_core": "0.1.0", "seed": seed},
        base_mesh_blob=blob,
    )
