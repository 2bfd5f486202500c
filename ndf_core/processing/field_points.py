"""A learned field at points of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ndf_core.asset.asset import Asset
from ndf_core.errors import InputError
from ndf_core.files import atomic_write
from ndf_core.readers.numpy_arrays import read_npz

_MOST_BYTES = 1 << 30


def evaluate_at_points(asset: Asset, name: str, source: Path, output: Path, threads: int = 1) -> dict[str, Any]:
    """Evaluate a field at the surface points closest to the array `points` of an .npz, and write another .npz.

    Returns:
        A report, JSON-ready.

    Raises:
        InputError: the file cannot be read, or has no finite points.
        AssetError: there is no such field.
        OutputError: the output cannot be written.
    """
    points = read_npz(source, _MOST_BYTES).get("points")
    if points is None or points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"{source}: needs an array `points` (n, 3) of finite numbers")
    asset.evaluator(name)
    faces, barycentric, offsets = asset.locate(points.astype(np.float64), threads)
    values = asset.values(name, faces, barycentric, threads)
    with atomic_write(output) as file:
        np.savez(file, points=points, values=values, offsets=offsets, base_faces=faces, base_barycentric=barycentric)
    return {
        "field": name,
        "points": len(points),
        "largest_offset": float(offsets.max(initial=0.0)),
        "least": float(values.min(initial=np.inf)),
        "largest": float(values.max(initial=-np.inf)),
    }
