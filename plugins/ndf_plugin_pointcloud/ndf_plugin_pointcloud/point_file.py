"""Any accepted file of points to arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.readers.ply_tables import read_ply_tables
from ndf_plugin_pointcloud.defaults import POINT_SUFFIXES
from ndf_plugin_pointcloud.detect import look
from ndf_plugin_pointcloud.pcd import read_pcd
from ndf_plugin_pointcloud.text_points import read_text_points

MOST_BYTES = 4 << 30
FEWEST = 10
"""Points that a surface can be guessed from."""
_FLAT = 1e-9
"""Points within this share of their size of a line are on it."""


@dataclass(frozen=True)
class PointCloud:
    """Distinct, finite points."""

    points: Float[Array, "n 3"]
    """float64, input units."""
    normals: Float[Array, "n 3"] | None
    """Unit vectors, as the file has them; None where it has none."""
    notes: tuple[str, ...]
    """What was left out, for the user."""

    @property
    def size(self) -> float:
        """Longest side of the bounding box."""
        return float(np.ptp(self.points, axis=0).max())


def read_point_file(path: Path) -> PointCloud:
    """Read a file of points by its content.

    Memory stays within a multiple of the file's size, whatever its header announces.

    Raises:
        InputError: the file cannot be read, or its points are no cloud.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a directory, not a file of points")
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: larger than {MOST_BYTES >> 30} GiB")
        content, data = look(path), path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    kind = content.format if content else path.suffix.lower().lstrip(".")
    readers = {"ply": _read_ply, "pcd": read_pcd, "text": read_text_points}
    if kind not in readers and path.suffix.lower() not in POINT_SUFFIXES:
        raise InputError(f"{path}: not a file of points; {' '.join(POINT_SUFFIXES)} are read")
    try:
        rows, normals = readers.get(kind, read_text_points)(data)
    except ValueError as error:
        raise InputError(f"{path}: cannot be read as {kind}: {error}") from error
    return point_cloud(rows, normals, str(path))


def point_cloud(rows: Array, normals: Array | None, origin: str) -> PointCloud:
    """Points without what is not finite and without duplicates (a duplicate's normals are averaged).

    Raises:
        InputError: fewer than ten distinct points are left, or all of them lie on a line.
    """
    notes: list[str] = []
    points = np.asarray(rows, dtype=np.float64)
    finite = (np.abs(points) < 1e60).all(axis=1)  # also false for NaN
    if not finite.all():
        notes.append(f"{int((~finite).sum()):,} points without finite coordinates left out")
    points = points[finite]
    normals = None if normals is None else np.asarray(normals, dtype=np.float64)[finite]
    if len(points):
        _, first, group = np.unique(points + 0.0, axis=0, return_index=True, return_inverse=True)
        if len(first) < len(points):
            notes.append(f"{len(points) - len(first):,} points at the place of others merged with them")
        if normals is not None:
            sums = [np.bincount(group.ravel(), np.nan_to_num(normals[:, k]), len(first)) for k in range(3)]
            normals = np.stack(sums, axis=1)
        order = np.argsort(first)  # as in the file
        points = points[first[order]]
        normals = None if normals is None else normals[order]
    if len(points) < FEWEST:
        raise InputError(f"{origin}: has {len(points):,} distinct finite points; {FEWEST} are needed at least")
    if normals is not None:
        points, normals = _with_normals(points, normals, notes, origin)
    centred = points - points.mean(axis=0)
    spread = np.linalg.svd(centred / np.abs(centred).max(), compute_uv=False)
    if spread[1] < _FLAT * spread[0]:
        raise InputError(f"{origin}: all its points lie on a line, which is no surface")
    return PointCloud(np.ascontiguousarray(points), normals, tuple(notes))


def _with_normals(
    points: Float[Array, "n 3"], normals: Float[Array, "n 3"], notes: list[str], origin: str
) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"]]:
    """Unit normals, and only the points that have one."""
    length = np.linalg.norm(normals, axis=1)
    usable = (length > 1e-12) & (length < 1e60)
    if usable.sum() < max(FEWEST, 0.5 * len(points)):
        raise InputError(
            f"{origin}: {int((~usable).sum()):,} of its {len(points):,} normals are zero or not finite; read it as "
            "points without normals with --repr points"
        )
    if not usable.all():
        notes.append(f"{int((~usable).sum()):,} points without a normal left out")
    return points[usable], normals[usable] / length[usable, None]


def _read_ply(data: bytes) -> tuple[Array, Array | None]:
    vertex = read_ply_tables(data).get("vertex", {})
    if not all(isinstance(vertex.get(axis), np.ndarray) for axis in "xyz"):
        raise ValueError("there are no vertices with x, y and z")
    points = np.stack([np.asarray(vertex[axis], dtype=np.float64) for axis in "xyz"], axis=1)
    names = ("nx", "ny", "nz")
    if not all(isinstance(vertex.get(name), np.ndarray) for name in names):
        return points, None
    return points, np.stack([np.asarray(vertex[name], dtype=np.float64) for name in names], axis=1)
