"""Opening `gaussians`: a file of splats becomes a solid, and its visible skin a surface to project onto."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.errors import InputError
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, Projector, Surface
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_plugin_gaussians.dilated import dilated_solid
from ndf_plugin_gaussians.filtering import filter_splats
from ndf_plugin_gaussians.fitted import fitted_solid
from ndf_plugin_gaussians.gaussians import TRAINING_DEFAULTS, GaussiansConfig
from ndf_plugin_gaussians.grid import Grid
from ndf_plugin_gaussians.layer import Boundary, visible_layer
from ndf_plugin_gaussians.moving_planes import MovingPlanes
from ndf_plugin_gaussians.projectors import CentreProjector, SmoothProjector
from ndf_plugin_gaussians.readers.splat_file import read_splat_file
from ndf_plugin_gaussians.solid import Solid, density_solid
from ndf_plugin_gaussians.splats import Splats
from ndf_plugin_gaussians.surfels import Surfels, cut

_LAYER = 1.0
"""Width of the cells that visible pieces are merged in, in cells of the grid."""
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
    # About the middle, so that coordinates far from the origin lose nothing.
    kept, filtered = filter_splats(splats, config, origin)
    surfels, grid = _pieces(kept, config)
    if config.base_mesh == "density":
        coarse, field = density_solid(surfels, grid, config.stands_on, config.min_component)
        layer = visible_layer(surfels, Boundary(coarse), coarse.depth, _LAYER * grid.step)
        planes = MovingPlanes(layer)
        solid = fitted_solid(coarse, field, grid, planes, config.min_component)
    else:
        solid = dilated_solid(kept)
        layer = visible_layer(surfels, Boundary(solid), solid.depth, _LAYER * grid.step)
        planes = MovingPlanes(layer)
    invented = f"{layer.invented:.1%} of the surface has no splats near it and follows the solid that they enclose"
    projector: Projector
    if config.projection == "smooth":
        projector = SmoothProjector(planes, Boundary(solid))
    else:
        projector = CentreProjector(kept.centres)
    return Surface(
        representation="gaussians",
        base_mesh=SolidExtractor(solid),
        projector=projector,
        fingerprint=fingerprint("gaussians", config, content),
        training_defaults=TRAINING_DEFAULTS,
        notes=(*notes, *filtered, *solid.notes, *([invented] if layer.invented > 0 else [])),
    )


class SolidExtractor(BaseMeshExtractor):
    """Base mesh of a solid: its boundary, coarsened."""

    def __init__(self, solid: Solid) -> None:
        self._solid = solid

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh; `seed` is not used, nothing here is random."""
        del seed
        return coarsen(self._solid.vertices, self._solid.faces, max_faces, remarks=self._solid.remarks)


def _pieces(splats: Splats, config: GaussiansConfig) -> tuple[Surfels, Grid]:
    """Pieces no wider than a cell of the grid, and the grid around nearly all of them."""
    spacing = float(np.ptp(splats.centres, axis=0).max()) / config.resolution
    surfels = cut(splats, spacing, config.min_opacity)
    low, high = np.quantile(surfels.points, [_TAIL, 1 - _TAIL], axis=0)
    grid = Grid.around(np.stack([low, high]), config.resolution)
    within = ((surfels.points > grid.bounds[0]) & (surfels.points < grid.bounds[1])).all(axis=1)
    return surfels.take(within), grid
