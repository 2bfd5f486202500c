"""The laws of `ndf_core.testing` on this plugin's representation."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from splat_shapes import on_surface
from splat_writers import inria

from ndf_core.testing import Motion
from ndf_core.testing.suite import RepresentationSuite


class TestGaussians(RepresentationSuite):
    name = "gaussians"
    options: ClassVar = {"resolution": 48, "stands_on": "none"}
    tolerance = 2e-3
    """A tenth of a cell: distances are interpolated on a grid that does not turn with the splats."""

    def source(self, folder: Path) -> Path:
        return _write(folder / "ball.ply", _splats())

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        splats = _splats()
        splats["centres"] = motion.apply(splats["centres"])
        splats["scales"] = motion.scale * splats["scales"]
        splats["rotations"] = _turned(motion.rotation, splats["rotations"])
        return _write(folder / "moved.ply", splats)


def _splats() -> dict[str, np.ndarray]:
    """Evenly over a sphere, on Fibonacci's spiral: gaps would be filled differently when they are turned."""
    height = (2 * np.arange(2000) + 1) / 2000 - 1
    angle = np.pi * (1 + np.sqrt(5)) * np.arange(2000)
    ring = np.sqrt(1 - height**2)
    normals = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    made = on_surface(normals, normals, 0.05)
    names = ("centres", "scales", "rotations", "opacities", "colours")
    return {name: np.array(getattr(made, name), dtype=np.float64) for name in names}


def _turned(rotation: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """The quaternions (w, x, y, z) after a rotation by less than half a turn."""
    w = np.sqrt(1 + np.trace(rotation)) / 2
    x, y, z = ((rotation - rotation.T)[[2, 0, 1], [1, 2, 0]]) / (4 * w)
    a, b, c, d = quaternions.T
    return np.stack(
        [w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b,
         w * d + x * c - y * b + z * a], axis=1
    )  # fmt: skip


def _write(path: Path, splats: dict[str, Any]) -> Path:
    path.write_bytes(inria(splats))
    return path
