"""Distances by the heat method: two solves with factors that do not depend on the sources."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.processing.operators import Operators
from ndf_core.processing.surface_points import SurfacePoints

_TINY = 1e-140


def heat_distances(operators: Operators, sources: SurfacePoints) -> Float[Array, " v"]:
    """Approximate distance of each vertex to the nearest of the sources; infinity where none is connected to it.

    The first call factorises, later ones on the same operators take milliseconds, so that sources can be dragged.
    The error is that of a smoothed distance: of the order of the edge length, most at sources and where geodesics
    meet. Sources inside faces spread their heat over the face's corners.

    Reference: Crane, Weischedel, Wardetzky 2013.
    """
    corners = operators.faces[sources.faces]
    spots = np.zeros(len(operators.vertices))
    np.add.at(spots, corners, sources.barycentric)
    heat = operators.heat.solve(spots)
    slope = operators.gradient @ heat
    steepness = _lengths(slope)
    # Where the heat is flat or has underflowed there is no direction; no flux is the least harmful guess.
    weight = np.divide(-operators.areas, steepness, out=np.zeros_like(steepness), where=steepness > 0)
    # Pairs of numbers seen as complex ones: one multiplication for each instead of two short loops.
    flux = (slope.view(np.complex128) * weight).view(np.float64)
    distances = operators.poisson.solve(operators.gradient.T @ flux)
    return _from_zero(operators, sources, distances)


def _lengths(vectors: Float[Array, " n"]) -> Float[Array, " m"]:
    """Of vectors x, y, x, y, ...; squares where they do not underflow, which they do far from the sources."""
    x, y = vectors[::2], vectors[1::2]
    lengths = np.sqrt(x * x + y * y)
    tiny = np.flatnonzero(lengths < _TINY)
    lengths[tiny] = np.hypot(x[tiny], y[tiny])
    return lengths


def _from_zero(operators: Operators, sources: SurfacePoints, distances: Float[Array, " v"]) -> Float[Array, " v"]:
    """Choose the constant of each component: at the corners around sources the distances are known."""
    corners = operators.faces[sources.faces]
    known = np.linalg.norm(operators.vertices[corners] - sources.positions[:, None], axis=2)
    excess = (sources.barycentric * (distances[corners] - known)).sum(axis=1)
    parts = operators.components
    part, count = parts[corners[:, 0]], int(parts.max()) + 1
    number = np.bincount(part, minlength=count)
    shift = np.bincount(part, excess, minlength=count) / np.maximum(number, 1)
    return np.where(number[parts] > 0, np.maximum(distances - shift[parts], 0.0), np.inf)
