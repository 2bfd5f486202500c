"""Smooth direction fields: n directions at every vertex, evenly turned, that vary as little as the surface allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array, csc_array

from ndf_core.errors import InputError
from ndf_core.processing.cholesky import Cholesky
from ndf_core.processing.operators import Operators
from ndf_core.processing.tangent_frames import TangentFrames, hermitian, smallest_eigenvector

_SHIFT = 1e-4
"""In mean distances of eigenvalues (4 pi / area)."""


@dataclass(frozen=True)
class DirectionField:
    """n unit directions at each vertex, turned by 2 pi / n against each other."""

    degree: int
    """n: 1 a vector, 2 a line, 4 a cross."""
    frames: TangentFrames
    representative: Complex[Array, " v"]
    """The n-th power of any of the directions, of length 1 (0 where there is none)."""
    indices: Int[Array, " f"]
    """Whole number k of each face: the field turns by 2 pi k / n around it, and k / n is its index."""
    energy: float
    """Smallest eigenvalue: mean squared change of the field, per area. 0 where directions were asked for."""

    @property
    def directions(self) -> Complex[Array, " v"]:
        """One of the directions at each vertex, of length 1, in the vertex's frame."""
        return np.exp(1j * np.angle(self.representative) / self.degree)

    @property
    def vectors(self) -> Float[Array, "v 3"]:
        """The same as unit vectors in space."""
        return self.frames.vectors(self.directions)

    @property
    def index_sum(self) -> float:
        """Sum of all indices: the Euler characteristic of a closed surface (Poincare and Hopf)."""
        return float(self.indices.sum()) / self.degree


def direction_field(
    operators: Operators,
    degree: int = 1,
    alignment: Float[Array, "v 3"] | None = None,
    smoothness: float = 1.0,
) -> DirectionField:
    """The smoothest field of `degree` directions, of all fields, or one near to given directions.

    Args:
        operators: Of an oriented manifold; a border is left free.
        degree: n, 1 to 12.
        alignment: Vectors at the vertices that the field is to follow, more where they are longer; zero where
            anything will do. What is normal to the surface does not count.
        smoothness: Weight of smoothness against the alignment; the larger, the less the field follows.

    Raises:
        InputError: a degree out of range, an alignment of the wrong shape or that is zero or not finite, a smoothness
            that is not positive, or a mesh that is no manifold.

    Reference: Knoppel, Crane, Pinkall, Schroeder 2013, with s = 0 and cotangent weights.
    """
    if not 1 <= degree <= 12:
        raise InputError(f"direction fields of degree {degree}: must be 1 to 12")
    frames = TangentFrames(operators)
    count, edges = len(frames.vertices), frames.edges
    start, end = frames.faces.ravel()[edges], np.roll(frames.faces, -1, axis=1).ravel()[edges]
    weight, turn = frames.weights[edges], frames.transport[edges] ** degree
    # |z_end - turn z_start|^2, weighted: the entry (end, start) is -weight * turn.
    rows = np.concatenate([start, end, end])
    columns = np.concatenate([start, end, start])
    matrix = hermitian(count, rows, columns, np.concatenate([weight, weight, -weight * turn]))
    spacing = 4 * np.pi / float(frames.areas.sum())
    if alignment is None:
        angle = 2 * np.pi * np.random.default_rng(0).random(count)
        field, energy = smallest_eigenvector(matrix, frames.mass, _SHIFT * spacing, np.exp(1j * angle))
    else:
        field, energy = _aligned(matrix, frames, degree, alignment, smoothness, spacing), 0.0
    length = np.abs(field)
    unit = np.divide(field, length, out=np.zeros_like(field), where=length > 0)
    return DirectionField(degree, frames, unit, _indices(frames, unit, degree), energy)


def _aligned(
    matrix: csc_array,
    frames: TangentFrames,
    degree: int,
    alignment: Float[Array, "v 3"],
    smoothness: float,
    spacing: float,
) -> Complex[Array, " v"]:
    """Least smoothness * energy + distance from the directions that are wanted (Sec. 3.2 there, t below 0)."""
    if alignment.shape != frames.vertices.shape or not np.isfinite(alignment).all():
        raise InputError(f"alignment: need {len(frames.vertices):,} finite vectors, got {alignment.shape}")
    if not 0 < smoothness < np.inf:
        raise InputError(f"smoothness {smoothness:g}: must be positive")
    wanted = frames.directions(alignment)
    length = np.abs(wanted)
    if not length.any():
        raise InputError("alignment: all vectors are zero, or normal to the surface")
    unit = np.divide(wanted, length, out=np.zeros_like(wanted), where=length > 0)
    pull = frames.mass * length / length.max()
    both = np.concatenate([pull, pull])
    # Where nothing pulls, the Laplacian alone must still be definite.
    least = 1e-9 * np.concatenate([frames.mass, frames.mass])
    diagonal = np.arange(len(both))
    system = csc_array(smoothness / spacing * matrix + csc_array(coo_array((both + least, (diagonal, diagonal)))))
    right = pull * unit**degree
    solution = Cholesky(system).solve(np.concatenate([np.real(right), np.imag(right)]))
    return solution[: len(right)] + 1j * solution[len(right) :]


def _indices(frames: TangentFrames, field: Complex[Array, " v"], degree: int) -> Int[Array, " f"]:
    """How often the field turns around each face, less what the surface's curvature turns it.

    Law: on a closed surface they add up to degree times the Euler characteristic.
    """
    start, end = frames.faces.ravel(), np.roll(frames.faces, -1, axis=1).ravel()
    turn = frames.transport
    change = np.angle(field[end] * (turn**degree * field[start]).conj()).reshape(-1, 3).sum(axis=1)
    curvature = np.angle(turn.reshape(-1, 3).prod(axis=1))
    return np.rint((change + degree * curvature) / (2 * np.pi)).astype(np.int64)
