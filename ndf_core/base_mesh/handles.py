"""Removal of tiny handles: cut along a short loop and close both cuts."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import winding_number
from ndf_core.base_mesh.loops import Loop, short_loops
from ndf_core.base_mesh.remarks import condense, triple
from ndf_core.interfaces import Remark
from ndf_core.mesh import topology

SMOOTHING = 4
"""Rounds of averaging that move the two closed cuts apart."""


def remove_small_handles(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], max_length: float
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"], list[Remark]]:
    """Cut every handle that a loop of at most `max_length` goes around, and fill every tunnel it goes through.

    Laws: a closed manifold mesh stays one, each removal takes 1 from the genus, and components stay.

    Args:
        vertices: Of a closed manifold mesh, outwards.
        max_length: In the units of the vertices.

    Returns:
        The mesh, and remarks of kind "cut_handle" and "filled_tunnel" with place and extent.
    """
    remarks: list[Remark] = []
    while (topology(faces, len(vertices)).genus or 0) > 0:
        loops = short_loops(vertices, faces, max_length)
        if not loops:
            break
        for loop in loops:
            remarks.append(_remark(vertices, faces, loop, max_length))
            vertices, faces = cut_and_close(vertices, faces, loop.vertices)
    return vertices, faces, condense(remarks)


def cut_and_close(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], loop: tuple[int, ...]
) -> tuple[Float[Array, "w 3"], Int[Array, "g 3"]]:
    """Cut a mesh along a simple closed path of edges and close both sides with a fan each; smooth the fans.

    The Euler characteristic grows by 2.
    """
    count, length = len(vertices), len(loop)
    left, right = np.array(loop), count + np.arange(length)
    middle = vertices[left].mean(axis=0)
    points = np.concatenate([vertices, vertices[left], [middle, middle]])
    # The faces to the right of the path get the copies of its vertices.
    cut = faces.astype(np.int64)
    for index, corners in _right_of(faces, loop).items():
        for corner, position in corners:
            cut[index, corner] = right[position]
    caps = [
        np.stack([np.full(length, count + length), np.roll(left, -1), left], axis=1),
        np.stack([np.full(length, count + length + 1), right, np.roll(right, -1)], axis=1),
    ]
    closed = np.concatenate([cut, *caps]).astype(np.int32)
    return _smooth(points, closed, np.concatenate([left, right, [count + length, count + length + 1]])), closed


def _right_of(faces: Int[Array, "f 3"], loop: tuple[int, ...]) -> dict[int, list[tuple[int, int]]]:
    """Faces right of the path: for each, its corners on the path as (corner, position along the path)."""
    near = np.flatnonzero(np.isin(faces, loop).any(axis=1))
    following = {  # around vertex a: from the edge to b, clockwise, to the edge to c
        (int(face[i]), int(face[(i + 2) % 3])): (int(row), i, int(face[(i + 1) % 3]))
        for row, face in zip(near, faces[near], strict=True)
        for i in range(3)
    }
    found: dict[int, list[tuple[int, int]]] = {}
    for position, vertex in enumerate(loop):
        ahead, behind = loop[(position + 1) % len(loop)], loop[position - 1]
        spoke = ahead
        while spoke != behind:
            row, corner, spoke = following[vertex, spoke]
            found.setdefault(row, []).append((corner, position))
    return found


def _smooth(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], free: Int[Array, " n"]) -> Float[Array, "v 3"]:
    """Move the `free` vertices to the means of their neighbours, a few times."""
    near = faces[np.isin(faces, free).any(axis=1)]
    pairs = np.unique(np.concatenate([near[:, [i, j]] for i in range(3) for j in range(3) if i != j]), axis=0)
    pairs = pairs[np.isin(pairs[:, 0], free)]
    slot = np.searchsorted(np.sort(free), pairs[:, 0])
    points = vertices.copy()
    for _ in range(SMOOTHING):
        total = np.zeros((len(free), 3))
        np.add.at(total, slot, points[pairs[:, 1]])
        points[np.sort(free)] = total / np.bincount(slot, minlength=len(free))[:, None]
    return points


def _remark(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], loop: Loop, max_length: float) -> Remark:
    points = vertices[list(loop.vertices)]
    inside = winding_number(points.mean(axis=0), vertices, faces) > 0.5
    what = "a thin handle is cut" if inside else "a narrow tunnel is filled"
    return Remark(
        kind="cut_handle" if inside else "filled_tunnel",
        message=f"{what}: a loop of length {loop.length:.4g} around it is shorter than {max_length:.4g}",
        position=triple(points.mean(axis=0)),
        size=float(np.linalg.norm(points.max(axis=0) - points.min(axis=0))),
    )
