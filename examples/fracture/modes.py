"""Fracture modes: the ways in which a solid breaks most easily (Sellan et al. 2023, "Breaking Good").

A mode is a displacement u of the exploded solid, of unit size and orthogonal to all modes before it, that minimises

    u^T Q u / 2  +  w * sum over walls of area * |jump of u|,

so an eigenvector of the stiffness Q that may also break. The jumps' norms are not squared, which makes most of them
zero: u is continuous but for a few surfaces, the cracks. The unit sphere is replaced by its tangent plane at a
vibration of the unbroken solid, which is where the mode is looked for: on the sphere itself a crumb that flies off is
cheaper than any crack. Each norm is replaced by a parabola that touches it at the last iterate (iteratively
reweighted least squares), so every step is one sparse factorisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.sparse.linalg import eigsh
from solid import Solid

from ndf_core.processing.cholesky import Cholesky

_STEPS = 14
_SHARP = (1e-1, 1e-4)
"""Jumps below this, at the first and last step, count squared; of a displacement of unit mean square."""
_CRACK = 0.05
"""A wall is broken where it opens by this share of the mode's largest opening."""
_LEAST = 0.04
"""Pieces of less than this share of the volume belong to the neighbour that they share most with."""


@dataclass(frozen=True)
class Mode:
    """One way to break."""

    pieces: Int[Array, " t"]
    """Of each tetrahedron, from 0."""
    motions: Float[Array, "k 3"]
    """Mean displacement of each piece."""
    energy: float


def fracture_modes(solid: Solid, count: int, weight: float) -> list[Mode]:
    """The first `count` modes, each orthogonal to every rigid motion of the pieces of those before it.

    A piece that comes off in one direction comes off as easily in five others: six modes with the same cracks. Taking
    all of them out at once leaves modes with cracks of their own.

    Args:
        solid: of about unit size.
        count: fewer are returned where the solid breaks in fewer ways.
        weight: of the cracks' area against the elastic energy, w above. Smaller breaks sooner.
    """
    rigid = _rigid(solid)
    basis = _joined(solid, np.zeros((len(rigid), 0)), rigid)
    modes = list[Mode]()
    for start in _vibrations(solid, 3 * count).T:
        found, energy = _minimise(solid, start, basis, weight)
        pieces = _pieces(solid, found)
        if pieces.max() == 0:
            basis = _joined(solid, basis, found[:, None])
            continue
        of_number = np.repeat(pieces, 12)[:, None]
        for piece in range(pieces.max() + 1):
            basis = _joined(solid, basis, rigid * (of_number == piece))
        share = solid.volumes[:, None] / np.bincount(pieces, solid.volumes)[pieces][:, None]
        mean = found.reshape(-1, 4, 3).mean(axis=1) * share
        motions = np.stack([np.bincount(pieces, mean[:, axis]) for axis in range(3)], axis=1)
        modes.append(Mode(pieces, motions, energy))
        if len(modes) == count:
            break
    return modes


def _joined(solid: Solid, basis: Float[Array, "n m"], more: Float[Array, "n k"]) -> Float[Array, "n l"]:
    """The basis with what is new in `more`, orthonormal in the mass of a solid of volume 1."""
    mass = (solid.mass / solid.mass.sum())[:, None]
    for _ in range(2):
        more = more - basis @ (basis.T @ (mass * more))
    left, sizes, _ = np.linalg.svd(np.sqrt(mass) * more, full_matrices=False)
    kept = sizes > 1e-6 * max(float(sizes.max()), 1e-6)
    return np.column_stack([basis, left[:, kept] / np.sqrt(mass)])


def _minimise(
    solid: Solid, start: Float[Array, " n"], orthogonal: Float[Array, "n m"], weight: float
) -> tuple[Float[Array, " n"], float]:
    mass, jumps, areas = solid.mass / solid.mass.sum(), solid.jumps, solid.walls[2]
    now = toward = _unit(start - orthogonal @ (orthogonal.T @ (mass * start)), mass)
    for step in range(_STEPS):
        sharp = _SHARP[0] * (_SHARP[1] / _SHARP[0]) ** (step / (_STEPS - 1))
        opening = np.linalg.norm((jumps @ now).reshape(-1, 9), axis=1)
        rigidity = np.repeat(weight * areas / np.hypot(opening, sharp), 9)
        matrix = solid.stiffness + jumps.T @ (sp.diags_array(rigidity) @ jumps) + sp.diags_array(1e-6 * mass)
        # Least energy with toward . u = 1 and u orthogonal to the modes before: two solves and a small system.
        conditions = mass[:, None] * np.column_stack([toward, orthogonal])
        solved = Cholesky(sp.csc_array(matrix)).solve(conditions)
        wanted = np.zeros(conditions.shape[1])
        wanted[0] = 1.0
        now = _unit(solved @ np.linalg.solve(conditions.T @ solved, wanted), mass)
    energy = now @ (solid.stiffness @ now) / 2 + weight * areas @ np.linalg.norm((jumps @ now).reshape(-1, 9), axis=1)
    return now, float(energy)


def _pieces(solid: Solid, displacement: Float[Array, " n"]) -> Int[Array, " t"]:
    pairs, _, areas = solid.walls
    opening = np.linalg.norm((solid.jumps @ displacement).reshape(-1, 9), axis=1)
    whole = opening < _CRACK * opening.max()
    count = len(solid.tetrahedra)
    graph = sp.coo_array((np.ones(int(whole.sum())), pairs[whole].T), shape=(count, count))
    pieces = sp.csgraph.connected_components(graph, directed=False)[1]
    while True:  # the smallest piece joins a neighbour until all are large enough
        volumes = np.bincount(pieces, solid.volumes)
        least = int(volumes.argmin())
        if volumes[least] >= _LEAST * volumes.sum():
            return pieces
        sides = pieces[pairs]
        border = (sides == least).any(axis=1) & (sides[:, 0] != sides[:, 1])
        others = np.where(sides[border, 0] == least, sides[border, 1], sides[border, 0])
        pieces[pieces == least] = np.bincount(others, areas[border]).argmax()
        pieces = np.unique(pieces, return_inverse=True)[1]


def _rigid(solid: Solid) -> Float[Array, "n 6"]:
    """Translations and rotations, of all exploded corners; orthogonal."""
    corners = solid.points[solid.tetrahedra].reshape(-1, 3)
    corners = corners - np.average(corners, axis=0, weights=solid.mass[::3])
    turns = [np.cross(axis, corners).ravel() for axis in np.eye(3)]
    moves = [np.tile(axis, len(corners)) for axis in np.eye(3)]
    root = np.sqrt(solid.mass)[:, None]
    return np.linalg.qr(root * np.array([*moves, *turns]).T)[0] / root


def _vibrations(solid: Solid, count: int) -> Float[Array, "n k"]:
    """Displacements of the unbroken solid of the lowest frequencies, without the rigid ones: where modes start."""
    corners = solid.tetrahedra.ravel()
    rows, columns = np.arange(3 * len(corners)), (3 * corners[:, None] + np.arange(3)).ravel()
    exploded = sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(rows), 3 * len(solid.points)))
    used = np.flatnonzero(np.diff(exploded.tocsc().indptr))
    exploded = exploded[:, used]
    stiffness = sp.csc_matrix(exploded.T @ solid.stiffness @ exploded)
    mass = sp.csc_matrix(sp.diags_array(exploded.T @ solid.mass))
    shift = -1e-3 * stiffness.diagonal().mean() / mass.diagonal().mean()
    start = np.random.default_rng(0).normal(size=stiffness.shape[0])
    return exploded @ eigsh(stiffness, count + 6, mass, sigma=shift, v0=start)[1][:, 6:]


def _unit(displacement: Float[Array, " n"], mass: Float[Array, " n"]) -> Float[Array, " n"]:
    return displacement / np.sqrt(mass @ displacement**2)
