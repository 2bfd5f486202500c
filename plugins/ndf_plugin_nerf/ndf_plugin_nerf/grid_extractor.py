"""Base mesh of a level set on a grid: small handles cut, then coarsened. For the outer level set, and for a TSDF."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy import ndimage

from ndf_core.base_mesh.coarsen import coarsen
from ndf_core.base_mesh.crumbs import drop_crumbs
from ndf_core.base_mesh.handles import remove_small_handles
from ndf_core.base_mesh.level_set import SEARCHED_FACES
from ndf_core.errors import BaseMeshError
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, Remark
from ndf_core.kernels.decimate import decimate
from ndf_plugin_nerf.isosurface import isosurface
from ndf_plugin_nerf.lattice import Nodes
from ndf_plugin_nerf.outer_field import OuterField
from ndf_plugin_nerf.outside import flooded

CLEARANCE = 2
"""Gaps and pits narrower than twice so many cells are closed: the base mesh spans them."""
_SMOOTHING = 1.0
"""Standard deviation of the Gaussian over the solid, in cells."""
_MIN_COMPONENT, _MIN_LOOP = 4.0, 12.0
"""Components with a smaller diagonal, and handles with a shorter loop, in cells, are left out."""


class GridExtractor(BaseMeshExtractor):
    """Marching cubes of values at nodes, negative inside.

    The level set of a trained density is rough at the scale of the grid and has hundreds of tunnels a cell or two
    wide; a handle needs some ten faces, so short ones go. Remarks: "dropped_component", "filled_cavity",
    "cut_handle", "filled_tunnel", and those of `coarsen`.
    """

    def __init__(
        self, grid: Callable[[], tuple[Nodes, Float[Array, "x y z"]]], remarks: Sequence[Remark] = ()
    ) -> None:
        """Take what makes the nodes and their values; it is called when a mesh is asked for."""
        self._grid, self._remarks = grid, remarks

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh; `seed` is not used, nothing here is random."""
        del seed
        nodes, values = self._grid()
        cell = float(nodes.step.max())
        vertices, faces = isosurface(nodes, values)
        if not len(faces):
            raise BaseMeshError("nothing solid is left after smoothing; raise --resolution or lower --threshold")
        vertices, faces, dropped = drop_crumbs(vertices, faces, _MIN_COMPONENT * cell)
        thinned = decimate(vertices, faces, SEARCHED_FACES)
        vertices, faces, removed = remove_small_handles(thinned.vertices, thinned.faces, _MIN_LOOP * cell)
        return coarsen(vertices, faces, max_faces, remarks=(*self._remarks, *dropped, *removed))


def smoothed(field: OuterField) -> tuple[Nodes, Float[Array, "x y z"]]:
    """1 outside, -1 inside, smoothed, with narrow gaps closed."""
    outside = flooded(~field.inside, CLEARANCE)
    # Up to one threshold of difference, values say where between nodes the surface lies.
    values = np.where(outside | field.inside, np.clip(field.values, -1.0, 1.0), -1.0)
    return field.nodes, ndimage.gaussian_filter(values, _SMOOTHING, mode="constant", cval=1.0)
