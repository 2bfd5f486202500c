"""Stripe patterns: evenly spaced stripes across a direction field, with few branches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from numpy import ndarray as Array
from scipy.sparse import coo_array, csc_array

from ndf_core.errors import InputError
from ndf_core.processing.direction_fields import DirectionField
from ndf_core.processing.tangent_frames import TangentFrames, smallest_eigenvector

_SHIFT = 1e-6
"""In squared frequencies."""


@dataclass(frozen=True)
class Stripes:
    """A phase: stripes are where its cosine is large."""

    values: Complex[Array, " v"]
    """psi of each vertex; its argument is the phase, up to the sign of the direction. Small where stripes end."""
    phases: Float[Array, "f 3"]
    """Phase at the corners of each face, continuous inside of it; stripes are even where it is linear."""
    indices: Int[Array, " f"]
    """Stripes that begin (or end) in each face: where this is not 0, the phase cannot be continuous."""
    branched: Bool[Array, " f"]
    """Faces where the direction field itself has half an index, so that directions have no consistent sign."""

    @property
    def cosines(self) -> Float[Array, " v"]:
        """Of the phase at the vertices, which no sign changes: 1 on a stripe, -1 between two."""
        return np.real(self.values) / np.maximum(np.abs(self.values), 1e-300)


def stripe_pattern(field: DirectionField, period: float | Float[Array, " v"]) -> Stripes:
    """Stripes at the distance `period` from each other whose phase grows along the field.

    Args:
        field: Of degree 1, or 2 where directions have no sign.
        period: Length from stripe to stripe in the mesh's units, everywhere or at each vertex. Longer than two edges
            of the mesh, or the stripes cannot be seen on it.

    Raises:
        InputError: a field of higher degree, or a period that is not positive or too short for the mesh.

    Reference: Knoppel, Crane, Pinkall, Schroeder 2015.
    """
    frames = field.frames
    if field.degree > 2:
        raise InputError(f"stripes need one direction: a field of degree {field.degree} has more")
    frequency = np.broadcast_to(2 * np.pi / np.asarray(period, dtype=np.float64), len(frames.vertices))
    if not (np.isfinite(frequency) & (frequency > 0)).all():
        raise InputError("the stripes' period must be positive")
    edge = float(frames.lengths.mean())
    shortest = 2 * np.pi / float(frequency.max())
    if shortest < 2 * edge:
        raise InputError(
            f"stripes with a period of {shortest:.3g} do not show on edges of {edge:.3g}: at least two edges long"
        )
    sign, change = _along_edges(frames, field, frequency)
    matrix = _energy(frames, sign, change)
    start = np.exp(2j * np.pi * np.random.default_rng(0).random(len(frames.vertices)))
    # Stripes wider than the surface leave a constant, with an eigenvalue of zero: the shift must not vanish as well.
    least = _SHIFT * 4 * np.pi / float(frames.areas.sum())
    shift = _SHIFT * max(float(np.mean(frequency)) ** 2, least)
    values, _ = smallest_eigenvector(matrix, frames.mass, shift, start)
    return Stripes(values, *_at_corners(frames, sign, change, values))


def _along_edges(
    frames: TangentFrames, field: DirectionField, frequency: Float[Array, " v"]
) -> tuple[Float[Array, " h"], Float[Array, " h"]]:
    """For each half-edge: whether the directions at its ends agree (1) or not (-1), and the change of phase."""
    start, end = frames.faces.ravel(), np.roll(frames.faces, -1, axis=1).ravel()
    direction = field.directions
    moved = frames.transport * direction[start]
    sign = np.where(np.real(moved * direction[end].conj()) >= 0, 1.0, -1.0)
    if field.degree == 1:
        sign = np.ones_like(sign)
    here = frequency[start] * np.cos(frames.angles - np.angle(direction[start]))
    there = frequency[end] * np.cos(frames.back_angles + np.pi - np.angle(direction[end]))
    return sign, frames.lengths.ravel() / 2 * (here + sign * there)


def _energy(frames: TangentFrames, sign: Float[Array, " h"], change: Float[Array, " h"]) -> csc_array:
    """Sum of weight |z_end - exp(i change) z_start|^2 over the edges, with z_end conjugated where the sign is -1."""
    edges, count = frames.edges, len(frames.vertices)
    start, end = frames.faces.ravel()[edges], np.roll(frames.faces, -1, axis=1).ravel()[edges]
    weight, sign = frames.weights[edges], sign[edges]
    real, imaginary = weight * np.cos(change[edges]), weight * np.sin(change[edges])
    diagonal = np.bincount(np.concatenate([start, end]), np.tile(weight, 2), minlength=count)
    place = np.arange(2 * count)
    blocks = [
        (end, start, -real),
        (end, start + count, imaginary),
        (end + count, start, -sign * imaginary),
        (end + count, start + count, -sign * real),
    ]
    rows = np.concatenate([place, *(row for row, _, _ in blocks), *(column for _, column, _ in blocks)])
    columns = np.concatenate([place, *(column for _, column, _ in blocks), *(row for row, _, _ in blocks)])
    entries = [np.tile(diagonal, 2), *(value for _, _, value in blocks), *(value for _, _, value in blocks)]
    return csc_array(coo_array((np.concatenate(entries), (rows, columns)), shape=(2 * count, 2 * count)))


def _at_corners(
    frames: TangentFrames, sign: Float[Array, " h"], change: Float[Array, " h"], values: Complex[Array, " v"]
) -> tuple[Float[Array, "f 3"], Int[Array, " f"], Bool[Array, " f"]]:
    """Phases continuous in each face, in the sense of direction of its corner 0."""
    sign, change = sign.reshape(-1, 3), change.reshape(-1, 3)
    branched = sign.prod(axis=1) < 0
    corner = values[frames.faces]
    # Corners 1 and 2 as seen with the direction of corner 0; the last edge's start is corner 2.
    sense = np.stack([np.ones(len(sign)), sign[:, 0], sign[:, 0] * sign[:, 1]], axis=1)
    seen = np.where(sense > 0, corner, corner.conj())
    along = sense * change
    following = np.roll(seen, -1, axis=1)
    step = along + np.angle(following * (np.exp(1j * along) * seen).conj())
    first = np.angle(seen[:, 0])
    phases = np.stack([first, first + step[:, 0], first + step[:, 0] + step[:, 1]], axis=1)
    turns = np.rint(step.sum(axis=1) / (2 * np.pi)).astype(np.int64)
    return phases, np.where(branched, 0, turns), branched


def phase_gradients(frames: TangentFrames, phases: Float[Array, "f 3"]) -> Float[Array, " f"]:
    """Length of the phase's gradient in each face: 2 pi over the distance of stripes there, or 0 without area."""
    corners = frames.vertices[frames.faces]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rise = np.stack([phases[:, 1] - phases[:, 0], phases[:, 2] - phases[:, 0]], axis=1)
    gram = np.stack([(one * one).sum(1), (one * two).sum(1), (two * two).sum(1)])
    determinant = gram[0] * gram[2] - gram[1] ** 2
    square = gram[2] * rise[:, 0] ** 2 - 2 * gram[1] * rise[:, 0] * rise[:, 1] + gram[0] * rise[:, 1] ** 2
    flat = determinant <= 0
    return np.where(flat, 0.0, np.sqrt(np.maximum(square, 0.0) / np.where(flat, 1.0, determinant)))
