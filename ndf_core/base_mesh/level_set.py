"""The base mesh of a scalar field: its zero level set, cleaned by a stated policy and coarsened."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.crumbs import drop_crumbs
from ndf_core.base_mesh.handles import remove_small_handles
from ndf_core.base_mesh.lattice import ScalarField
from ndf_core.base_mesh.marching_cubes import marching_cubes
from ndf_core.base_mesh.narrow_band import Band, sample_near_level_set
from ndf_core.base_mesh.remarks import triple
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, Remark
from ndf_core.kernels.decimate import decimate
from ndf_core.mesh import Topology, topology

SEARCHED_FACES = 60_000
"""A mesh is decimated to so many faces before short loops are looked for, which keeps its topology."""


@dataclass(frozen=True)
class LevelSetPolicy:
    """How finely to look, and what is too small to keep."""

    resolution: int = 256
    """Cells along the longest side of the bounds."""
    max_resolution: int = 512
    """Taken when the Euler characteristic or the components differ between `resolution` and half of it."""
    min_component: float = 4.0
    """Components and cavities with a smaller bounding-box diagonal, in cells of `resolution`, are left out."""
    min_loop: float = 8.0
    """Handles and tunnels with a shorter loop, in cells of the resolution reached, are removed, but only if the
    topology still differs between it and half of it: what both agree on is taken for real, however thin."""
    bisections: int = 3
    """Halvings of the crossed edges, for fields without a distance bound (those may be occupancies)."""


class LevelSetExtractor(BaseMeshExtractor):
    """Marching cubes in a narrow band of a field that is negative inside.

    Everything that the base mesh lacks of the sampled level set is in its remarks: "dropped_component",
    "filled_cavity", "cut_handle", "filled_tunnel", "capped" (the level set reaches the bounds and is closed there),
    "topology_not_settled" (two resolutions disagree), "faces_not_reached", "self_intersections".
    """

    def __init__(
        self,
        field: ScalarField,
        bounds: Float[Array, "2 3"],
        *,
        lipschitz: float | None = None,
        distance: ScalarField | None = None,
        near: Float[Array, "n 3"] | None = None,
        policy: LevelSetPolicy | None = None,
    ) -> None:
        """Hold the field; nothing is evaluated yet.

        Args:
            field: Values at float64 points (n, 3) in input units, negative inside; rows are independent. Only
                called within `bounds`.
            bounds: Lowest and highest corner of the box to look in, input units.
            lipschitz: ``|field| <= lipschitz * distance to the level set`` everywhere in the bounds (1 for distances
                and for CSG bounds); None where nothing of the kind holds.
            distance: The absolute value of `field`, where it is much cheaper without the sign (needs `lipschitz`).
            near: Points that the level set passes within about a cell, on each of its components; finds thin parts
                that a field without a `lipschitz` bound may hide.

        Raises:
            BaseMeshError: the bounds are empty or not finite.
        """
        self._bounds = np.asarray(bounds, dtype=np.float64)
        if not np.isfinite(self._bounds).all() or (self._bounds[1] <= self._bounds[0]).any():
            raise BaseMeshError(f"the bounds of a level set need two finite corners, low below high; got {bounds}")
        self._field = field
        self._lipschitz = lipschitz
        self._distance = distance
        self._near = near
        self._policy = policy if policy is not None else LevelSetPolicy()

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh; `seed` is not used, nothing here is random."""
        del seed
        vertices, faces, remarks = self.dense()
        return coarsen(vertices, faces, max_faces, remarks=remarks)

    def dense(self) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"], list[Remark]]:
        """The closed manifold mesh that the base mesh is cut from, with the remarks about what it lacks.

        Raises:
            BaseMeshError: the field has no negative value in the bounds, or is not a number somewhere.
        """
        policy = self._policy
        resolution = policy.resolution
        while True:
            band = sample_near_level_set(
                self._field, self._bounds, resolution, self._lipschitz, self._distance, self._near
            )
            fine, half = self._mesh(band, 1), self._mesh(band, 2)
            settled = fine.same_topology(half)
            if settled or 2 * resolution > policy.max_resolution:
                break
            resolution *= 2
        if settled:
            # A higher resolution was only taken to decide; where it agrees, the mesh asked for is good enough.
            chosen = fine if resolution == policy.resolution else half
            return chosen.vertices, chosen.faces, [*chosen.remarks, *_capped(band)]
        limit = policy.min_loop * float(band.lattice.step.max())
        thinned = decimate(fine.vertices, fine.faces, SEARCHED_FACES)
        vertices, faces, removed = remove_small_handles(thinned.vertices, thinned.faces, limit)
        return vertices, faces, [*fine.remarks, *removed, _not_settled(resolution, fine, half), *_capped(band)]

    def _mesh(self, band: Band, width: int) -> _Dense:
        bisections = self._policy.bisections if self._lipschitz is None else 0
        vertices, faces = marching_cubes(band, width, self._field, bisections)
        remarks: list[Remark] = []
        if len(faces):
            cell = float(np.ptp(self._bounds, axis=0).max()) / self._policy.resolution
            vertices, faces, remarks = drop_crumbs(vertices, faces, self._policy.min_component * cell)
        return _Dense(vertices, faces, remarks, topology(faces, len(vertices)))


@dataclass(frozen=True)
class _Dense:
    """The level set at one resolution, without crumbs."""

    vertices: Float[Array, "v 3"]
    faces: Int[Array, "f 3"]
    remarks: list[Remark]
    counts: Topology

    def same_topology(self, other: _Dense) -> bool:
        mine, theirs = self.counts, other.counts
        return (mine.euler_characteristic, mine.components) == (theirs.euler_characteristic, theirs.components)


def _not_settled(resolution: int, fine: _Dense, half: _Dense) -> Remark:
    one, other = fine.counts, half.counts
    return Remark(
        kind="topology_not_settled",
        message=(
            f"at resolution {resolution} the level set has {one.components} components of total genus {one.genus}, "
            f"at {resolution // 2} it has {other.components} of {other.genus}: parts are as thin as the cells; raise "
            f"the resolution to keep them"
        ),
    )


def _capped(band: Band) -> list[Remark]:
    """A remark if the inside reaches the bounds."""
    index = band.lattice.corner_index(band.corners[band.values < 0])
    border = index[((index == 1) | (index == band.lattice.inner + 1)).any(axis=1)]
    if not len(border):
        return []
    points = band.lattice.positions(border)
    low, high = points.min(axis=0), points.max(axis=0)
    sides = [
        f"{sign}{axis}"
        for k, axis in enumerate("xyz")
        for sign, at in (("-", 1), ("+", int(band.lattice.inner[k]) + 1))
        if (index[:, k] == at).any()
    ]
    return [
        Remark(
            kind="capped",
            message=f"the level set reaches the bounds at {', '.join(sides)} and is closed there with a flat cap",
            position=triple(0.5 * (low + high)),
            size=float(np.linalg.norm(high - low)),
            count=len(sides),
        )
    ]
