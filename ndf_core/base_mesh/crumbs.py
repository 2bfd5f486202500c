"""Removal of tiny components, with a remark for what goes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import component_volumes
from ndf_core.base_mesh.remarks import condense, triple
from ndf_core.interfaces import Remark
from ndf_core.mesh import face_components


def drop_crumbs(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], min_size: float
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], list[Remark]]:
    """Leave out the components whose bounding-box diagonal is below `min_size`, except the largest one.

    A small component with negative volume is a cavity, and leaving it out fills it.

    Args:
        min_size: In the units of the vertices.

    Returns:
        The rest, and remarks of kind "dropped_component" and "filled_cavity".
    """
    label = face_components(faces, len(vertices))
    count = int(label.max()) + 1
    if count == 1:
        return vertices, faces, []
    low, high = _boxes(vertices, faces, label, count)
    sizes = np.linalg.norm(high - low, axis=1)
    small = sizes < min_size
    small[sizes.argmax()] = False
    if not small.any():
        return vertices, faces, []
    cavity = component_volumes(vertices, faces) < 0
    middles = 0.5 * (low + high)
    reason = f"smaller than {min_size:.4g}, the least size of a component"
    remarks = [
        Remark("filled_cavity", f"a cavity is filled, {reason}", triple(middles[row]), float(sizes[row]))
        if cavity[row]
        else Remark(
            "dropped_component", f"a component is left out, {reason}", triple(middles[row]), float(sizes[row])
        )
        for row in np.flatnonzero(small)
    ]
    return *compact(vertices, faces[~small[label]]), condense(remarks)


def largest_component(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> float:
    """Bounding-box diagonal of the largest component, in the units of the vertices."""
    label = face_components(faces, len(vertices))
    low, high = _boxes(vertices, faces, label, int(label.max()) + 1)
    return float(np.linalg.norm(high - low, axis=1).max())


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
