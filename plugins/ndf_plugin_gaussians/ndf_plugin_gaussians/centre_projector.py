"""The paper's projection onto splats: the closest centre (Sec. 4.2, Fig. gs)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector


class CentreProjector(Projector):
    """The closest centre of a splat; every row converges, there are no normals.

    Runs in double precision on the CPU; queries on another device are copied there and back.
    """

    def __init__(self, centres: Float[Array, "n 3"]) -> None:
        self._tree = KDTree(centres)
        self._centres = centres

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        query = points.detach().to("cpu", torch.float64)
        finite = query.isfinite().all(dim=1)
        if not bool(finite.all()):
            raise InputError(f"cannot project query point {int((~finite).nonzero()[0])}: a coordinate is not finite")
        index = self._tree.query(query.numpy(), workers=torch.get_num_threads())[1]
        converged = torch.ones(len(query), dtype=torch.bool, device=points.device)
        return Projection(torch.from_numpy(self._centres[index]).to(points), converged, None)
