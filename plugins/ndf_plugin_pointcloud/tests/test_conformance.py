"""The laws of `ndf_core.testing` on every representation of this plugin."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from clouds import cloud, ring

from ndf_core.testing import Motion
from ndf_core.testing.suite import RepresentationSuite


class TestSoup(RepresentationSuite):
    """The ring with a hole."""

    name = "soup"
    options: ClassVar = {"resolution": 64}

    def source(self, folder: Path) -> Path:
        return _write(folder / "torn.obj", np.asarray(ring().vertices))

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        return _write(folder / "moved.obj", motion.apply(np.asarray(ring().vertices)))


class TestOrientedPoints(RepresentationSuite):
    name = "oriented-points"

    def source(self, folder: Path) -> Path:
        return _points(folder / "ring.xyz", *cloud(ring(), 3000))

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        points, normals = cloud(ring(), 3000)
        return _points(folder / "moved.xyz", motion.apply(points), motion.turn(normals))


class TestPoints(RepresentationSuite):
    name = "points"
    tolerance = 5e-3
    """A third of the spacing: planes are fitted to the points, which none of them goes through."""

    def source(self, folder: Path) -> Path:
        return _points(folder / "ring.xyz", cloud(ring(), 3000)[0])

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        return _points(folder / "moved.xyz", motion.apply(cloud(ring(), 3000)[0]))


def _points(path: Path, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.hstack(columns), fmt="%.17g")
    return path


def _write(path: Path, vertices: np.ndarray) -> Path:
    faces = ring().faces[40:] + 1
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    path.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in faces), ""]))
    return path
