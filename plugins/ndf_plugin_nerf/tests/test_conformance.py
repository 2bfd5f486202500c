"""The laws of `ndf_core.testing` on this plugin's representation: a grid of densities, and a function."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from nerf_shapes import ball, solid

from ndf_core.testing import Motion, NotAsked
from ndf_core.testing.suite import RepresentationSuite

FUNCTION = """
import numpy as np

scale, turn, shift = SCALE, np.array(TURN), np.array(SHIFT)


def density(points):
    own = (points - shift) @ turn / scale
    distance = np.linalg.norm(own * [1.0, 1.2, 0.9], axis=1) - 1.0
    return np.clip(20.0 - 200.0 * distance, -200.0, 200.0) / scale  # per unit of length


density.bounds = shift + 1.6 * scale * np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
"""


class TestGrid(RepresentationSuite):
    name = "nerf"
    options: ClassVar = {"resolution": 48}
    tolerance = 2e-3
    """A tenth of a cell: samples lie on triangles across the cells, and the threshold is found on a lattice."""

    def source(self, folder: Path) -> Path:
        axes = [np.linspace(-1.5, 1.5, 40)] * 3
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        values = solid(ball())(points).reshape(40, 40, 40).astype(np.float32)
        np.savez(folder / "ball.npz", density=values, bounds=np.array([[-1.5] * 3, [1.5] * 3]))
        return folder / "ball.npz"

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        raise NotAsked("a grid cannot be turned, and a density per unit of length changes with the unit")


class TestFunction(RepresentationSuite):
    name = "nerf"
    expected_failures: ClassVar = {
        "sniff_knows_the_source": "the name of a function does not say that it is a density: it is left to `analytic`"
    }
    options: ClassVar = {"resolution": 48}
    tolerance = 2e-3
    """A tenth of a cell: samples lie on triangles across the cells, and the threshold is found on a lattice."""

    def source(self, folder: Path) -> str:
        return _write(folder / "still.py", 1.0, np.eye(3), np.zeros(3))

    def moved(self, source: str, motion: Motion, folder: Path) -> str:
        return _write(folder / "moved.py", motion.scale, motion.rotation, motion.translation)


def _write(path: Path, scale: float, turn: np.ndarray, shift: np.ndarray) -> str:
    text = FUNCTION.replace("SCALE", repr(scale)).replace("TURN", repr(turn.tolist()))
    path.write_text(text.replace("SHIFT", repr(shift.tolist())))
    return f"{path}:density"
