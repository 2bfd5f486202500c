"""Heat that spreads over a surface from sources that may move: one factor for all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.processing.operators import Operators
from ndf_core.processing.surface_points import SurfacePoints


class HeatFlow:
    """Implicit steps of du/dt = Laplace u + sources, u(0) = 0, with natural boundary conditions.

    The matrix M + t L of a step of length t does not know the sources, so nothing is factorised when they move: a
    step is one solve, however long it is, since implicit steps are stable.

    Laws: total heat grows by the sources' power times the time; without sources it stays, and no value
    leaves the range of the values before (the triangulation is Delaunay).

    Reference: Crane, Weischedel, Wardetzky 2013, Sec. 3.2 (backward Euler).
    """

    def __init__(self, operators: Operators, step: float) -> None:
        """Factorise.

        Args:
            operators: Of the mesh.
            step: Time of a step, in squared units of length: heat comes about the root of it far.

        Raises:
            InputError: the step is not positive.
        """
        if not 0 < step < np.inf:
            raise InputError(f"the time of a step of the heat flow is {step:g}: must be positive")
        self.step = step
        self._operators = operators
        self._factor = operators.heat_step(step)
        self.heat = np.zeros(len(operators.vertices))
        """Temperature of each vertex."""

    def reset(self, heat: Float[Array, " v"] | None = None) -> None:
        """Start again, from `heat` or from zero.

        Raises:
            InputError: not one finite value for each vertex.
        """
        now = np.zeros_like(self.heat) if heat is None else np.array(heat, dtype=np.float64)
        if now.shape != self.heat.shape or not np.isfinite(now).all():
            raise InputError(f"heat: need {len(self.heat):,} finite values, got shape {now.shape}")
        self.heat = now

    def advance(self, sources: SurfacePoints | None = None, power: float = 1.0, steps: int = 1) -> Float[Array, " v"]:
        """Go on for some steps with sources of `power` (heat per time) each; the new temperatures.

        Sources inside faces heat the corners by their weights.
        """
        flow = np.zeros_like(self.heat)
        if sources is not None:
            np.add.at(flow, self._operators.faces[sources.faces], power * sources.barycentric)
        for _ in range(steps):
            self.heat = self._factor.solve(self._operators.lumped_mass * self.heat + self.step * flow)
        return self.heat


def diffuse(
    operators: Operators, points: Float[Array, "n 3"] | Sequence[Sequence[float]], time: float, steps: int = 16
) -> Float[Array, " v"]:
    """Temperatures a time after one unit of heat was put on each of some points, closest points of the mesh.

    Laws: integrates to the number of points; scaled by s, the mesh has after s^2 times the time 1 / s^2 of the
    temperatures.

    Args:
        operators: Of the mesh.
        points: At least one.
        time: In squared units of length.
        steps: Implicit steps that it is cut into; the error falls with one over their number.

    Raises:
        InputError: no point, one that is not finite, a time that is not positive, or no step.
    """
    if not len(points):
        raise InputError("diffusion needs at least one source")
    if steps < 1:
        raise InputError(f"{steps} steps of diffusion: need at least one")
    flow = HeatFlow(operators, time / steps)
    sources = operators.closest(np.asarray(points, dtype=np.float64))
    # A unit of heat within the first step.
    flow.advance(sources, power=1 / flow.step)
    return flow.advance(steps=steps - 1)
