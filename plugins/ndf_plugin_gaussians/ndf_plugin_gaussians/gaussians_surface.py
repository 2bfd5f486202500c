"""Opening `gaussians`: a file of splats becomes a solid, and its visible skin a surface to project onto."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.base_mesh.checks import longest_side
from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.errors import InputError
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, ColoredPoints, Surface
from ndf_core.surfaces.dilation import sampling_spacing
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_core.surfaces.level_set_projector import LevelSetProjector
from ndf_core.surfaces.random_lines import sample_level_set
from ndf_plugin_gaussians.centre_projector import CentreProjector
from ndf_plugin_gaussians.dilated import dilated_solid
from ndf_plugin_gaussians.distances import like_distances
from ndf_plugin_gaussians.filtering import FEWEST, filter_splats
from ndf_plugin_gaussians.gaussians import SMOOTH_TRAINING_DEFAULTS, TRAINING_DEFAULTS, GaussiansConfig
from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.grid_field import GridField
from ndf_plugin_gaussians.layer import Boundary, spacing_at, visible_layer
from ndf_plugin_gaussians.readers.splat_file import read_splat_file
from ndf_plugin_gaussians.slab import find_slab, with_slab
from ndf_plugin_gaussians.smooth_surface import smooth_surface
from ndf_plugin_gaussians.solid import Mesh, density_solid, meshed, without_crumbs
from ndf_plugin_gaussians.splats import Splats
from ndf_plugin_gaussians.surfels import Surfels, cut

_OPAQUE = 0.5
"""Centres of splats at least this opaque decide where in their skin the surface lies."""
_CORRECTIONS = 1
"""Steps of a projection towards the closest point: the field holds distances."""
_LAYER = 0.75
"""Width of the cells that visible pieces are merged in, in cells of the surface's grid."""
_COARSEST, _FINEST = 48, 192
"""Cells along the longest side, where no number is given."""
_CELL = 1.25
"""Width of a cell then, in distances of opaque centres from their sixth neighbour."""
_FINER = 1.3
"""So many cells of the surface's grid are as wide as one of the grid that finds the inside."""
_SLAB, _SLAB_CELLS = 0.03, 2.5
"""Thickness of a slab, as a share of the longest side, and at least so many cells."""
_BESIDE_SLAB = 0.1
"""Factor on the least size of a component beside one, whose own size says nothing."""
_IMPORTANT = 10.0
"""An error of the base mesh counts at most so many times more or less than in the median."""
_TAIL = 5e-4
"""Share of the pieces at either end of an axis that may lie beyond the grid."""


def open_gaussians(source: str | Path | object, config: GaussiansConfig) -> Surface:
    """Open a file of splats, or `Splats`.

    Raises:
        InputError: it cannot be read, or hardly any splat is left after filtering.
        BaseMeshError: the splats are opaque nowhere.
    """
    if isinstance(source, Splats):
        splats, notes, origin = source, (), "the splats"
    elif isinstance(source, str | Path):
        splats, notes = read_splat_file(Path(source))
        origin = str(source)
    else:
        raise InputError("gaussians: need a file of splats, or ndf_plugin_gaussians.splats.Splats")
    content = [splats.centres, splats.scales, splats.rotations, splats.opacities]
    kept, filtered = filter_splats(splats, config, origin)
    surfels, coarse, fine = _pieces(kept, config)
    if config.base_mesh == "density":
        solid = density_solid(surfels, coarse, config.stands_on, config.min_component)
    else:
        solid = dilated_solid(kept, coarse, config.min_component)
    outer = meshed(solid.field, coarse)
    opaque = _opaque(kept).centres
    boundary = Boundary(outer)
    layer = visible_layer(surfels, boundary, solid, _LAYER * fine.step, opaque)
    thickness = max(_SLAB * longest_side(outer.vertices), _SLAB_CELLS * fine.step)
    slab = find_slab(boundary, solid.depth, opaque, thickness) if config.thicken else None
    if slab is not None:
        layer = with_slab(layer, slab)
    smallest = config.min_component * (_BESIDE_SLAB if slab else 1.0)
    inside = without_crumbs(smooth_surface(fine, layer, opaque, solid.ground), smallest)[0]
    mesh = meshed(inside, fine)
    surface = GridField(like_distances(inside, fine, Boundary(mesh)), fine)
    smooth = config.projection == "smooth"
    base = mesh if config.base_mesh == "density" else outer
    said = [] if slab is None else [slab.note()]
    if layer.invented > 0:
        said.append(f"{layer.invented:.1%} of the surface has no splats near it and follows the solid they enclose")
    return Surface(
        representation="gaussians",
        base_mesh=MeshedSolidExtractor(base, opaque),
        projector=LevelSetProjector(surface, _CORRECTIONS) if smooth else CentreProjector(kept.centres),
        fingerprint=fingerprint("gaussians", config, content),
        training_defaults=SMOOTH_TRAINING_DEFAULTS if smooth else TRAINING_DEFAULTS,
        sample=(lambda count, rng: sample_level_set(surface, count, rng)) if smooth else None,
        colors=lambda: _colors(kept),
        notes=(*notes, *filtered, *solid.notes, *said),
    )


class MeshedSolidExtractor(BaseMeshExtractor):
    """Base mesh of a solid: its boundary, coarsened, less so where opaque centres are dense."""

    def __init__(self, boundary: Mesh, opaque: Float[Array, "k 3"]) -> None:
        self._boundary = boundary
        self._opaque = opaque

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh; `seed` is not used, nothing here is random."""
        del seed
        boundary = self._boundary
        return coarsen(
            boundary.vertices, boundary.faces, max_faces, remarks=boundary.remarks, importance=self._importance
        )

    def _importance(self, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """Training made many small splats where it saw detail."""
        spacing = spacing_at(points, self._opaque)
        return np.clip(np.median(spacing) / np.maximum(spacing, 1e-300), 1.0 / _IMPORTANT, _IMPORTANT)


def _opaque(splats: Splats) -> Splats:
    """The opaque splats, or all where hardly any are."""
    rows = splats.opacities >= _OPAQUE
    return splats.take(rows) if rows.sum() > FEWEST else splats


def _colors(splats: Splats) -> ColoredPoints | None:
    """Colours of degree 0 at the centres of the opaque splats."""
    opaque = splats.take(splats.opacities >= _OPAQUE)
    return ColoredPoints(opaque.centres, np.clip(opaque.colours, 0.0, 1.0)) if len(opaque) else None


def _pieces(splats: Splats, config: GaussiansConfig) -> tuple[Surfels, Grid, Grid]:
    """Pieces no wider than a cell, and the grids of the inside and of the surface, around nearly all of them."""
    size = float(np.ptp(splats.centres, axis=0).max())
    resolution = config.resolution or _resolution(splats, size)
    surfels = cut(splats, size / resolution / _FINER, config.min_opacity)
    low, high = np.quantile(surfels.points, [_TAIL, 1 - _TAIL], axis=0)
    grid = Grid.around(np.stack([low, high]), resolution)
    within = ((surfels.points > grid.bounds[0]) & (surfels.points < grid.bounds[1])).all(axis=1)
    return surfels.take(within), grid, grid.refined(_FINER)


def _resolution(splats: Splats, size: float) -> int:
    """Cells as wide as what the splats show: finer ones would show the splats themselves."""
    spacing = float(np.median(sampling_spacing(_opaque(splats).centres)))
    return int(np.clip(size / max(_CELL * spacing, size / _FINEST), _COARSEST, _FINEST))
