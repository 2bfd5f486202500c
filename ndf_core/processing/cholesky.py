"""Sparse Cholesky factors: factorise once, solve many times."""

from __future__ import annotations

import numpy as np
from cholespy import CholeskySolverD, MatrixType  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.sparse import csc_array

from ndf_core.errors import InputError


class Cholesky:
    """The factor of a symmetric positive definite matrix.

    CHOLMOD with nested dissection (cholespy): SuperLU's ordering collapses on subdivided meshes, where it takes
    fifty times as long.
    """

    def __init__(self, matrix: csc_array) -> None:
        """Factorise; only one triangle of `matrix` is read.

        Raises:
            InputError: the matrix is not positive definite, or has an entry that is not finite.
        """
        entries = matrix.tocoo()
        rows, columns = (np.ascontiguousarray(index, dtype=np.int32) for index in entries.coords)
        values = np.ascontiguousarray(entries.data, dtype=np.float64)
        if not np.isfinite(values).all():  # CHOLMOD would return NaN without a word
            raise InputError("the matrix to factorise has entries that are not finite: the mesh is degenerate")
        self._size = len(matrix.diagonal())
        try:
            self._solver = CholeskySolverD(self._size, rows, columns, values, MatrixType.COO)
        except ValueError as error:
            raise InputError(f"cannot factorise the matrix ({error}): the mesh is degenerate") from error

    def solve(self, right_side: Float[Array, "n *k"]) -> Float[Array, "n *k"]:
        """The solution for each column."""
        right_side = np.ascontiguousarray(right_side, dtype=np.float64)
        if len(right_side) != self._size:  # read beyond its end otherwise
            raise ValueError(f"right side: need {self._size} rows, got {len(right_side)}")
        solution = np.empty_like(right_side)
        self._solver.solve(right_side, solution)
        return solution
