"""A user's function as an `ImplicitField`."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_plugin_sdf.slope import estimated_slopes
from ndf_plugin_sdf.user_function import UserFunction

_SAMPLES = 8192


class CallableField(ImplicitField):
    """phi from a function of points, differentiated automatically where that works and numerically where not."""

    def __init__(self, function: UserFunction, bounds: Box, lipschitz: float | None = None) -> None:
        """Take the function's word for `bounds`; estimate `lipschitz` where it is not given.

        Raises:
            InputError: the function fails, gives a number that is not finite, or is constant.
        """
        self.function = function
        self.bounds = bounds
        # Central differences err by the step squared and by rounding over the step: the best step is the cube root of
        # the precision.
        self._step = bounds.longest_side * (4e-3 if function.single_precision else 1e-5)
        points = bounds.lower + np.random.default_rng(0).random((_SAMPLES, 3)) * (bounds.upper - bounds.lower)
        values, gradients = self.values_and_gradients(torch.from_numpy(points))
        slopes = gradients.square().sum(dim=1).sqrt()
        if not bool(slopes.isfinite().all()):
            raise InputError(f"{function.name} is not differentiable inside the bounds: its gradient is not finite")
        if float(slopes.max()) == 0.0:
            kind = "an occupancy" if bool((values < 0).any()) and bool((values > 0).any()) else "a constant"
            raise InputError(f"{function.name} is {kind}, its gradient is zero; it must grow away from the surface")
        self.lipschitz = float(slopes.max()) if lipschitz is None else lipschitz
        if lipschitz is None:
            slopes_seen = estimated_slopes(self, torch.from_numpy(points))
            self.lipschitz = slopes_seen.lipschitz if slopes_seen is not None else self.lipschitz

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        return self.function(points)

    def values(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """phi at any number of points.

        Raises:
            InputError: a value is not finite.
        """
        values = super().values(points)
        finite = values.isfinite()
        if not bool(finite.all()):
            row = int((~finite).nonzero()[0])
            place = ", ".join(f"{x:.6g}" for x in points[row].tolist())
            raise InputError(
                f"{self.function.name} gives {float(values[row])} at ({place}); it must be finite everywhere"
            )
        return values

    def evaluate_with_gradient(
        self, points: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        if self.function.differentiable:
            return super().evaluate_with_gradient(points)
        with torch.no_grad():
            moves = torch.eye(3, dtype=points.dtype, device=points.device) * self._step
            around = torch.cat([points + sign * move for move in moves for sign in (1.0, -1.0)])
            ahead, behind = self.evaluate(around).reshape(3, 2, -1).unbind(dim=1)
            return self.evaluate(points), ((ahead - behind) / (2.0 * self._step)).T
