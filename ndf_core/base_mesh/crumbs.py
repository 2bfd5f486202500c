"""Removal of tiny components, with a remark for what goes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import component_volumes
from ndf_core.interfaces import Remark
from ndf_core.mesh import face_components

LISTED = 8
"""So many of a kind get a remark each; the rest share one."""


def drop_crumbs(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], min_size: float
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], list[Remark]]:
    """Leave out the components whose bounding-box diagonal is below `min_size`, except the largest one.

    A small component with negative volume is a cavity, and leaving it out fills it.

    Args:
        min_size: In the units of the vertices.

    Returns:
        The rest, and remarks of kind "dropped_component" and "filled_cavity", the largest first.
    """
    label = face_components(faces, len(vertices))
    count = int(label.max()) + 1
    low, high = _boxes(vertices, faces, label, count)
    sizes = np.linalg.norm(high - low, axis=1)
    small = sizes < min_size
    small[sizes.argmax()] = False
    if not small.any():
        return vertices, faces, []
    cavity = component_volumes(vertices, faces) < 0
    middles = 0.5 * (low + high)
    remarks = [
        *_remarks("dropped_component", "a component is left out", small & ~cavity, sizes, middles, min_size),
        *_remarks("filled_cavity", "a cavity is filled", small & cavity, sizes, middles, min_size),
    ]
    return *compact(vertices, faces[~small[label]]), remarks


def compact(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> tuple[Float[Array, "w 3"], Int[Array, "f 3"]]:
    """Without the vertices that no face uses; the order stays."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int32)


def _boxes(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], label: Int[Array, " f"], count: int
) -> tuple[Float[Array, "c 3"], Float[Array, "c 3"]]:
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for corner in range(3):
        np.minimum.at(low, label, vertices[faces[:, corner]])
        np.maximum.at(high, label, vertices[faces[:, corner]])
    return low, high


def _remarks(
    kind: str,
    what: str,
    chosen: Bool[Array, " c"],
    sizes: Float[Array, " c"],
    middles: Float[Array, "c 3"],
    min_size: float,
) -> list[Remark]:
    rows = np.flatnonzero(chosen)
    rows = rows[np.argsort(-sizes[rows], kind="stable")]
    reason = f"it is smaller than {min_size:.4g}, the least size of a component"
    remarks = [
        Remark(kind, f"{what}: {reason}", position=_triple(middles[row]), size=float(sizes[row]))
        for row in rows[:LISTED]
    ]
    rest = rows[LISTED:]
    if len(rest):
        message = f"{what}, {len(rest)} times more: {reason}; place and size are those of the largest"
        remarks.append(Remark(kind, message, _triple(middles[rest[0]]), float(sizes[rest[0]]), count=len(rest)))
    return remarks


def _triple(point: Float[Array, " 3"]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
