"""Smallest eigenvalues of the Laplace-Beltrami operator, with their eigenfunctions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.linalg import eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import LinearOperator, eigsh

from ndf_core.errors import InputError
from ndf_core.processing.cholesky import Cholesky
from ndf_core.processing.operators import MassKind, Operators

_DENSE = 400
"""Meshes of at most so many vertices are solved as dense matrices, which has no limit on k."""
_MOST_NUMBERS = 1 << 29
"""In the Krylov basis: 4 GiB."""
_SHIFT = 1e-2
"""In mean distances of eigenvalues. Positive makes the matrix definite; small keeps the low eigenvalues apart."""


@dataclass(frozen=True)
class Spectrum:
    """Eigenpairs of L u = lambda M u, ascending."""

    eigenvalues: Float[Array, " k"]
    """One over length squared; one zero for each component."""
    eigenfunctions: Float[Array, "v k"]
    """Columns, M-orthonormal; the largest value of each is positive."""
    mass: MassKind


def laplace_spectrum(operators: Operators, count: int, mass: MassKind = "mean") -> Spectrum:
    """The `count` smallest eigenpairs of the Laplacian (natural boundary conditions).

    Laws: eigenvalues are not negative; scaling the mesh by s divides them by s^2; the same on every run.
    Eigenfunctions of equal eigenvalues are any basis of their space.

    Raises:
        InputError: `count` is not positive, larger than the number of vertices, or so large that the basis would not
            fit in memory.
    """
    size = len(operators.vertices)
    if not 1 <= count <= size:
        raise InputError(f"{count} eigenvalues of a mesh with {size:,} vertices: ask for 1 to {size:,}")
    stiffness, weights = operators.laplacian, operators.mass(mass)
    if size <= _DENSE:
        values, functions = eigh(stiffness.toarray(), weights.toarray(), subset_by_index=(0, count - 1))
    else:
        if max(2 * count + 1, 20) * size > _MOST_NUMBERS or count >= size - 1:
            most = min(size - 2, (_MOST_NUMBERS // size - 1) // 2)
            raise InputError(
                f"{count:,} eigenpairs of {size:,} vertices do not fit in memory: ask for {most:,} at most"
            )
        values, functions = _smallest(stiffness, weights, count, _SHIFT * 4 * math.pi / operators.area)
    order = np.argsort(values, kind="stable")
    values, functions = np.maximum(values[order], 0.0), functions[:, order]
    largest = np.abs(functions).argmax(axis=0)
    return Spectrum(values, functions * np.sign(functions[largest, np.arange(count)]), mass)


def _smallest(
    stiffness: csc_array, weights: csc_array, count: int, shift: float
) -> tuple[Float[Array, " k"], Float[Array, "v k"]]:
    """Lanczos on the inverse of L + shift M (App. B.1). Weyl's law: eigenvalues are 4 pi / area apart on average."""
    size = len(weights.diagonal())
    inverse = _Inverse(Cholesky(csc_array(stiffness + shift * weights)), size)
    start = np.random.default_rng(0).normal(size=size)
    values, functions = eigsh(stiffness, count, weights, sigma=-shift, OPinv=inverse, v0=start)
    return np.asarray(values), np.asarray(functions)


class _Inverse(LinearOperator):
    def __init__(self, factor: Cholesky, size: int) -> None:
        super().__init__(np.float64, (size, size))
        self._factor = factor

    def _matvec(self, x: Float[Array, " v"]) -> Float[Array, " v"]:
        return self._factor.solve(x)
