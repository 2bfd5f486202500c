"""The solid that splats are the skin of: where they are opaque, and what they hide from every side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy import ndimage

from ndf_core.base_mesh.level_set import LevelSetExtractor, LevelSetPolicy
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import Remark
from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.openness import (
    HIDDEN,
    Side,
    find_ground,
    openness,
    parse_side,
    side_name,
)
from ndf_plugin_gaussians.surfels import Surfels

LEVEL = 0.5
"""Density of the skin's border. One full layer of opaque splats has 1 in its middle, real captures 2 to 5."""
_BLUR = 1.0
"""Standard deviation in cells that the density is smoothed with, so that thin splats do not slip between nodes."""
_FAIRING = 0.7
"""The same for the field whose level set is the base mesh."""
_LEAST = 0.05
"""Nodes nearer to a level set than this are moved away to it: they would make triangles too small to be stored."""
OFFSET = 2.0
"""Cells from the middle of the skin to its border, about."""
_FOOT = 0.15
"""Share of the height, from below, in which the ground is looked for."""
_COMPLETE = 0.9
"""The ground's section has at least this share of the largest one there."""


@dataclass(frozen=True)
class Ground:
    """The plane that an object stands on."""

    side: Side
    level: float
    """Coordinate along the side's axis."""

    def height(self, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """Above the ground, towards the object."""
        axis, sign = self.side
        return (self.level - points[:, axis]) * sign


@dataclass(frozen=True)
class Solid:
    """A solid on a grid."""

    field: Float[Array, "x y z"]
    """Positive inside; zero at the boundary."""
    depth: float
    """How far below the boundary the visible splats lie, about; input units."""
    notes: tuple[str, ...]
    ground: Ground | None = None
    """Where it was cut flat."""


@dataclass(frozen=True)
class Mesh:
    """Closed manifold triangles in input units, outwards."""

    vertices: Float[Array, "v 3"]
    faces: Int[Array, "f 3"]
    remarks: tuple[Remark, ...]


def density_solid(surfels: Surfels, grid: Grid, stands_on: str, min_component: float) -> Solid:
    """Where the splats' opacity density is high, with what that hides.

    The density is the sum of opacity times Gaussian, smoothed by a cell; the thinnest axis of a splat counts as at
    least as wide, without losing opacity. What is seen from less than a tenth of all directions past the opaque cells
    is inside. Openings underneath are closed by looking from no direction below the ground, and cutting there.

    Args:
        surfels: pieces of the splats, not wider than a cell.
        grid: where the density is sampled.
        stands_on: "auto", "none", or a side such as "-z".
        min_component: smallest component kept, as a share of the largest.

    Raises:
        BaseMeshError: nothing is opaque.
    """
    density = _density(surfels, grid)
    skin = density > LEVEL
    if not skin.any():
        raise BaseMeshError(
            "the splats are opaque nowhere: there is no surface. Lower --min-opacity, or look at the file in a viewer"
        )
    ground = find_ground(skin) if stands_on == "auto" else None if stands_on == "none" else parse_side(stands_on)
    notes: list[str] = []
    if ground is not None:
        found = "found to be open underneath" if stands_on == "auto" else "as asked"
        notes.append(f"stands on {side_name(ground)} ({found}): closed there with a flat cap (--stands-on)")
    field = np.where(skin, density / LEVEL - 1.0, (HIDDEN - openness(skin, ground)) / HIDDEN)
    field = np.maximum(np.clip(field, -1.0, 1.0), np.clip(density / LEVEL - 1.0, -1.0, 1.0))
    plane = None
    if ground is not None:
        field, plane = _cut_off(field, ground, grid)
    field, note = without_crumbs(ndimage.gaussian_filter(field, _FAIRING), min_component)
    return Solid(field, OFFSET * grid.step, (*notes, *note), plane)


def _density(surfels: Surfels, grid: Grid) -> Float[Array, "x y z"]:
    # A layer of opacity 1 has the mass `area` per area; smoothed over its normal it has area / (sqrt(2 pi) blur)
    # in its middle, hence the factor that makes this 1.
    mass = grid.deposit(surfels.points, surfels.weights * surfels.areas) / grid.step**3
    return ndimage.gaussian_filter(mass, _BLUR, mode="constant") * (np.sqrt(2.0 * np.pi) * _BLUR * grid.step)


def _cut_off(field: Float[Array, "x y z"], side: Side, grid: Grid) -> tuple[Float[Array, "x y z"], Ground]:
    """Without what lies below the ground: the last layer whose section is complete. Splats grow few and ragged below
    it, as nobody looked there."""
    axis, sign = side
    layers = np.moveaxis(field > 0, axis, 0)[::-sign]
    area = layers.sum(axis=(1, 2))
    within = np.flatnonzero(area)
    lowest = area[within[0] : within[0] + max(1, int(_FOOT * len(within)))]
    first = int(within[0] + np.flatnonzero(lowest >= _COMPLETE * lowest.max())[0])
    cut = field.copy()
    np.moveaxis(cut, axis, 0)[::-sign][:first] = -1.0
    # The boundary lies half a cell beyond the last layer that is left.
    place = first - 0.5 if sign < 0 else field.shape[axis] - 1 - (first - 0.5)
    return cut, Ground(side, float(grid.low[axis] + grid.step * place))


def without_crumbs(field: Float[Array, "x y z"], smallest: float) -> tuple[Float[Array, "x y z"], list[str]]:
    """Without small components and without cavities; also a note about those.

    Args:
        field: between about -1 and 1, positive inside.
        smallest: least number of nodes of a component, as a share of the largest one's.

    Raises:
        BaseMeshError: nothing is inside.
    """
    label, count = _labelled(field > 0)
    if not count:
        raise BaseMeshError("the splats hide nothing and are opaque hardly anywhere: there is no surface")
    sizes = np.bincount(label.ravel())
    sizes[0] = 0
    kept = sizes >= smallest * sizes.max()
    kept[0] = False
    solid: Bool[Array, "x y z"] = kept[label]
    field = np.where(~solid & (field > 0), -0.1, field)
    cavity, _ = _labelled(~solid)
    field = np.where(~solid & (cavity != cavity[0, 0, 0]), 0.5, field)
    dropped = count - int(kept.sum())
    note = f"{int(kept.sum())} components kept, {dropped} smaller than {smallest:g} of the largest left out"
    return field, [f"{note} (--min-component)"] if dropped else []


def _labelled(cells: Bool[Array, "x y z"]) -> tuple[Int[Array, "x y z"], int]:
    """Number of each cell's component from 1 on, 0 where there is none, and how many there are."""
    label = np.zeros(cells.shape, np.int32)
    return label, int(ndimage.label(cells, output=label))  # pyright: ignore[reportArgumentType]  # a count, given output


def meshed(field: Float[Array, "x y z"], grid: Grid) -> Mesh:
    """The zero level set of a field that is positive inside, and changes by about 1 from node to node there.

    Raises:
        BaseMeshError: nothing is inside.
    """
    field = np.where(np.abs(field) < _LEAST, np.copysign(_LEAST, field), field)
    # From the second node to the last but one: all that is asked for lies on nodes.
    bounds = grid.bounds + np.array([[grid.step], [-grid.step]])
    cells = max(grid.shape) - 3
    policy = LevelSetPolicy(resolution=cells, max_resolution=cells)
    extractor = LevelSetExtractor(lambda points: -grid.values(field, points), bounds, policy=policy)
    vertices, faces, remarks = extractor.dense()
    # That handles as thin as a cell are not certain is no news: that is what they are cut for.
    told = tuple(remark for remark in remarks if remark.kind != "topology_not_settled")
    return Mesh(vertices, faces, told)
