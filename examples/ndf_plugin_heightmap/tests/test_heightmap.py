"""The laws of ndf on a small terrain, and what is this plugin's own."""

from __future__ import annotations

from pathlib import Path

import ndf_core
import numpy as np
import pytest
from ndf_core.errors import InputError
from ndf_core.testing import Motion
from ndf_core.testing.suite import RepresentationSuite
from ndf_plugin_heightmap.terrain import read_terrain

X, Y = np.meshgrid(np.linspace(0, 6, 24), np.linspace(0, 5, 20))
HEIGHTS = np.sin(X) * np.cos(Y)
"""From south to north."""


def write(path: Path, heights: np.ndarray, corner: np.ndarray, spacing: float) -> Path:
    rows, columns = heights.shape
    head = f"ncols {columns}\nnrows {rows}\nxllcenter {corner[0]}\nyllcenter {corner[1]}\ncellsize {spacing}\n"
    path.write_text(head + "\n".join(" ".join(map(repr, row)) for row in heights[::-1].tolist()) + "\n")
    return path


class TestLaws(RepresentationSuite):
    name = "heightmap"
    tolerance = 1e-9

    def source(self, folder: Path) -> Path:
        return write(folder / "hills.asc", HEIGHTS, np.zeros(2), 0.25)

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path | None:
        rotation = motion.rotation
        if np.allclose(rotation, np.eye(3)):
            heights, first = HEIGHTS, (0, 0)
        elif np.allclose(rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]]):
            heights, first = np.rot90(HEIGHTS, -1), (HEIGHTS.shape[0] - 1, 0)  # (x, y) becomes (-y, x)
        else:
            return None  # a heightmap cannot lean, nor lie askew
        place = np.array([[first[1] * 0.25, first[0] * 0.25, 0.0]])
        corner = motion.apply(place)[0]
        return write(
            folder / "moved.asc", motion.scale * heights + motion.translation[2], corner[:2], motion.scale * 0.25
        )


def test_the_first_row_of_a_file_is_the_northern_one(tmp_path: Path) -> None:
    path = tmp_path / "ramp.asc"
    path.write_text("ncols 2\nnrows 3\nxllcorner 10\nyllcorner 20\ncellsize 2\n5 6\n3 4\n1 2\n")
    terrain = read_terrain(path)
    assert terrain.heights.tolist() == [[1, 2], [3, 4], [5, 6]]
    assert terrain.corner == (11, 21)


def test_cells_without_data_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "gap.asc"
    path.write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -9\n1 2\n-9 4\n")
    with pytest.raises(InputError, match=r"gap\.asc: 1 cells have no data"):
        ndf_core.open(path)
