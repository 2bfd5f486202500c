"""A solid as a function that is negative inside, and the box that its surface lies in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.surfaces.box import Box


class ImplicitField(ABC):
    """phi: negative inside, positive outside, zero on the surface. Everything in float64 and input units.

    Rows are independent. Points are evaluated in blocks, so that memory stays bounded whatever their number.
    """

    bounds: Box
    """Finite; the whole surface lies in it."""
    lipschitz: float
    """|phi(x)| <= lipschitz * (distance of x to the surface), for x in `bounds`."""
    block: int = 65_536
    """Most points per evaluation."""
    has_plateaus: bool = False
    """Whether there are places far from the surface where the gradient says little about it, as in occupancies."""
    parallel: bool = False
    """Whether many points are evaluated faster in parts, each on a thread of its own (`Projector.parallel`)."""
    rounding: float = 1e-10
    """|phi| / |grad phi| that rounding leaves at the surface, as a share of the size; no step gets below it."""

    @abstractmethod
    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """phi of one block."""

    def evaluate_with_gradient(
        self, points: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        """phi and its gradient of one block, by automatic differentiation."""
        # A query may come from inference mode, whose tensors cannot take part in differentiation: hence the copy.
        with torch.inference_mode(False), torch.enable_grad():
            variable = points.detach().clone().requires_grad_(True)
            values = self.evaluate(variable)
            (gradient,) = torch.autograd.grad(values.sum(), variable)
        return values.detach(), gradient

    def values(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """phi at any number of points."""
        with torch.no_grad():
            blocks = [self.evaluate(part) for part in points.split(self.block)]
        return torch.cat(blocks) if blocks else points.new_empty(0)

    def values_and_gradients(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        """phi and its gradient at any number of points."""
        blocks = [self.evaluate_with_gradient(part) for part in points.split(self.block)]
        if not blocks:
            return points.new_empty(0), points.new_empty(0, 3)
        return torch.cat([values for values, _ in blocks]), torch.cat([gradients for _, gradients in blocks])

    def clearance(self, points: Float[Tensor, "n 3"], values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Distances within which there is no surface, from phi at these points; a field may know better ones."""
        del points
        return values.abs() / self.lipschitz

    def on_arrays(self) -> Callable[[Float[Array, "n 3"]], Float[Array, " n"]]:
        """phi as a function of numpy arrays, for the base mesh."""
        return lambda points: self.values(torch.from_numpy(np.ascontiguousarray(points, np.float64))).numpy()
