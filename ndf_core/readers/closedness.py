"""Whether the triangles of a file close up: what `mesh` and `soup` agree on when they look at it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from ndf_core.errors import InputError

MOST_BYTES = 64 << 20
"""Larger files are not read for a first look."""


def is_closed(path: Path) -> bool | None:
    """Whether every edge has two triangles, after equal vertices (or those within the rounding of single precision)
    were merged; None for a file that cannot be read as triangles, or has more than 64 MiB.

    Reads the whole file; asked again about the same file, it remembers.
    """
    try:
        status = path.stat()
    except OSError:
        return None
    if status.st_size > MOST_BYTES:
        return None
    return _closed(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=8)
def _closed(path: Path, modified: int, size: int) -> bool | None:
    del modified, size  # part of the key
    # numpy takes a tenth of a second, which a look at a file that has no triangles need not pay.
    import numpy as np

    from ndf_core.readers.mesh_file import read_mesh_file

    try:
        mesh = read_mesh_file(path)
    except (InputError, OSError, MemoryError):
        return None
    faces, count = mesh.faces, len(mesh.vertices)
    if faces.min() < 0 or faces.max() >= count or not np.isfinite(mesh.vertices[faces]).all():
        return None
    used = mesh.vertices[np.unique(faces)]
    rounding = max(1e-6 * float(np.ptp(used, axis=0).max()), 1e-300)
    for places in (None, mesh.vertices + 0.0, np.rint((mesh.vertices - used[0]) / rounding)):
        if places is not None:
            faces = np.unique(places, axis=0, return_inverse=True)[1].reshape(-1)[mesh.faces]
        distinct = (faces != faces[:, [1, 2, 0]]).all(axis=1)
        if places is None and not distinct.all():
            continue
        start, end = faces[distinct].ravel(), faces[distinct][:, [1, 2, 0]].ravel()
        key = np.sort(np.minimum(start, end).astype(np.int64) * count + np.maximum(start, end))
        paired = len(key) % 2 == 0 and len(key) > 0
        if paired and (key[::2] == key[1::2]).all() and (key[1:-1:2] != key[2::2]).all():
            return True
    return False
