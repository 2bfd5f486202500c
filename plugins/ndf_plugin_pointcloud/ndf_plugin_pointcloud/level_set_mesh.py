"""The level set w = 1/2 as a dense mesh, made once: the base mesh is cut from it, and samples start from it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.errors import InputError
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, Remark
from ndf_core.kernels.winding import WindingTree
from ndf_plugin_pointcloud.landing import Landing
from ndf_plugin_pointcloud.triangles import Triangles

_MARGIN = 0.05
"""Room around the samples, as a share of the longest side: caps over holes may bulge."""
_COARSEST, _FINEST = 48, 256
_SMALL = 0.5
"""Area, in squares of the longest side, below which more than 256 cells are taken along it, for about as many in all:
a surface that is long for its area is thin. Ordinary ones have 0.6 to 2.5, a sword has 0.11."""
_MOST_CELLS = 650_000
"""Cells that the level set may go through: the winding number is asked for at some five times as many nodes. Ordinary
surfaces have 0.1 to 0.6 million at 512 cells along the longest side."""


class WindingExtractor(BaseMeshExtractor):
    """Base mesh of w = 1/2: marching cubes around the samples, coarsened."""

    def __init__(
        self,
        tree: WindingTree,
        samples: Float[Array, "n 3"],
        area: float,
        cell: float,
        finest: int | None,
        threads: int = 1,
    ) -> None:
        """Hold the field; nothing is evaluated yet.

        Args:
            tree: w.
            samples: points near all of the level set but the caps over holes.
            area: of the level set without those caps, about, input units; cells are larger where it is so large that
                too many would be needed.
            cell: wished size of a cell, input units; finer shows the samples rather than the surface. 0: the least.
            finest: most cells along the longest side; None: 256, up to four times as many where the area is small.
            threads: for the field.
        """
        low, high = samples.min(axis=0), samples.max(axis=0)
        side = float((high - low).max())
        margin = _MARGIN * side
        if finest is None:
            finest = int(np.clip(_FINEST * side * np.sqrt(_SMALL / max(area, 1e-300)), _FINEST, 4 * _FINEST))
        most = (side + 2 * margin) * np.sqrt(_MOST_CELLS / max(area, 1e-300))
        resolution = int(np.clip(min((side + 2 * margin) / max(cell, 1e-300), most), min(_COARSEST, finest), finest))
        # Looked at twice as finely where the topology is not settled, if that is affordable.
        twice = 2 * resolution if 2 * resolution <= most else resolution
        self.resolution = resolution
        """Cells along the longest side of the box, at first."""
        self._extractor = LevelSetExtractor(
            lambda points: 0.5 - tree.values(points, threads),
            np.stack([low - margin, high + margin]),
            near=samples,
            policy=LevelSetPolicy(resolution=resolution, max_resolution=twice, bisections=2),
        )

    @cached_property
    def dense(self) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"], list[Remark]]:
        """Closed and manifold, with remarks about what it lacks."""
        return self._extractor.dense()

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh; `seed` is not used, nothing here is random."""
        del seed
        vertices, faces, remarks = self.dense
        return coarsen(vertices, faces, max_faces, remarks=remarks)


def sample_by_landing(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    land: Callable[[Float[Array, "n 3"]], Landing],
    count: int,
    rng: np.random.Generator,
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """`count` points on a surface itself, about even by area, with normals: samples of a mesh near it, projected.

    Args:
        vertices, faces: a mesh that is off the surface by a fraction of a cell.
        land: projects onto the surface.
        count: points wanted.
        rng: for the samples.

    Raises:
        InputError: they do not land.
    """
    found: list[Float[Array, "n 3"]] = []
    normals: list[Float[Array, "n 3"]] = []
    mesh, missing = Triangles(vertices, faces.astype(np.int64), ()), count
    for _ in range(20):
        points, outwards, landed = land(mesh.sample(missing, rng)[0])
        found.append(points[landed])
        normals.append(outwards[landed])
        missing -= int(landed.sum())
        if not missing:
            return np.concatenate(found), np.concatenate(normals)
    raise InputError("hardly any sample of the surface can be projected onto it")
