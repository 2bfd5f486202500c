"""What the projectors of this plugin share: arrays in, arrays out, on the CPU."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.interfaces import Projection, Projector
from ndf_plugin_pointcloud.spatial_order import spatial_order


class Landing(NamedTuple):
    """Where queries end, one row each."""

    points: Float[Array, "n 3"]
    """Finite; rows that did not land stay where they are."""
    normals: Float[Array, "n 3"]
    """Unit, outwards."""
    landed: Bool[Array, " n"]


class LandingProjector(Projector):
    """A projector of numpy arrays.

    Runs in double precision on the CPU; queries on another device are copied there and back. Uses as many threads as
    torch does.
    """

    parallel = True

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        query = points.detach().to("cpu", torch.float64).numpy()
        finite = np.isfinite(query).all(axis=1)
        if not finite.all():
            raise InputError(f"cannot project query point {int((~finite).argmax())}: a coordinate is not finite")
        order = spatial_order(query)
        landing = self.land(query[order], torch.get_num_threads())
        back = np.empty_like(order)
        back[order] = np.arange(len(order))
        found = Landing(*(rows[back] for rows in landing))
        return Projection(
            torch.from_numpy(found.points).to(points),
            torch.from_numpy(found.landed).to(points.device),
            torch.from_numpy(found.normals).to(points),
        )

    @abstractmethod
    def land(self, query: Float[Array, "n 3"], threads: int = 1) -> Landing:
        """Project finite points, float64, input units."""
