"""Soft clay under studio light: normals per corner, and the light that a normal sends to the eye."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.mesh import corner_angles, face_normals

CLAY = (0.835, 0.805, 0.765)
"""Default surface colour, sRGB."""

# Camera frame: x right, y up, z towards the eye.
_KEY = np.array([-0.42, 0.60, 0.68])
_FILL = np.array([0.80, 0.05, 0.60])
_SKY = np.array([1.02, 1.06, 1.14])
_GROUND = np.array([0.70, 0.64, 0.58])


def corner_normals(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], crease: float | int = 40.0
) -> Float[Array, "f 3 3"]:
    """Unit normal at each corner of each face: the mean of the faces around the vertex that bend less than `crease`.

    Faces count by their angle at the vertex. Degenerate faces take no part; at their own corners they get the mean of
    all faces there.

    Args:
        crease: degrees; 0 gives flat faces.
    """
    flat = face_normals(vertices, faces)
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = np.divide(flat, length, out=np.zeros_like(flat), where=length > 0)
    if crease <= 0:
        return np.repeat(flat[:, None], 3, axis=1)
    weighted = (flat[:, None] * corner_angles(vertices, faces)[..., None]).reshape(-1, 3)
    one, two = _corner_pairs(faces, len(vertices))
    near = np.einsum("ij,ij->i", flat[one // 3], flat[two // 3]) > np.cos(np.radians(crease))
    near |= ~length[one // 3, 0].astype(bool)
    one, two = one[near], two[near]
    total = np.stack([np.bincount(one, weighted[two, k], minlength=faces.size) for k in range(3)], axis=1)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, size, out=np.repeat(flat, 3, axis=0), where=size > 1e-12).reshape(-1, 3, 3)


def clay_light(normals: Float[Array, "n 3"]) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Linear light sent to the eye by a matt white surface, and the highlight added to it, for camera-frame normals.

    A key light over the left shoulder, wrapped around the shape, a weak fill from the right, and a sky that is
    brighter than the ground. A surface facing the eye sends about 1.
    """
    key, fill = _KEY / np.linalg.norm(_KEY), _FILL / np.linalg.norm(_FILL)
    toward_key = normals @ key
    wrapped = np.clip((toward_key + 0.25) / 1.25, 0, None)
    direct = 0.92 * wrapped**1.5 + 0.10 * np.clip(normals @ fill, 0, None)
    height = 0.5 + 0.5 * normals[:, 1:2]
    ambient = 0.30 * (_GROUND + (_SKY - _GROUND) * height)
    grazing = np.clip(1 - normals[:, 2], 0, 1)
    ambient = ambient * (1 - 0.45 * grazing[:, None] ** 2)  # the sky is partly hidden where the shape turns away
    half = key + np.array([0.0, 0.0, 1.0])
    highlight = 0.08 * np.clip(normals @ (half / np.linalg.norm(half)), 0, None) ** 28
    return ambient + direct[:, None], highlight


def to_linear(srgb: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Linear light of sRGB values in [0, 1]."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """sRGB values in [0, 1] of linear light; brighter light is clipped."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)


def _corner_pairs(faces: Int[Array, "f 3"], vertex_count: int) -> tuple[Int[Array, " p"], Int[Array, " p"]]:
    """All ordered pairs of corners (3 * face + i) at the same vertex, each corner paired with itself too."""
    vertex = faces.ravel()
    valence = np.bincount(vertex, minlength=vertex_count)
    order = np.argsort(vertex, kind="stable")
    first = np.concatenate([[0], np.cumsum(valence)])[vertex]
    count = valence[vertex]
    one = np.repeat(np.arange(len(vertex)), count)
    within = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    return one, order[np.repeat(first, count) + within]
