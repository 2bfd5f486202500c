"""Evaluation of one field network over the base mesh or over space: the interface of `src/field.c`."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.kernels import _field  # pyright: ignore[reportAttributeAccessIssue]  # compiled, no stub

_SLICE = 4096
"""Fewest rows that are worth a thread of their own."""


INSTRUCTIONS = 2
"""Best instruction set that may be used, where the processor has it: 2 AVX-512, 1 AVX2, 0 the platform's own."""


class FieldArrays(NamedTuple):
    """A field block as plain float32 arrays (Sec. 3.3): [x, sin and cos of 2^k base_frequency x, features], ReLU."""

    base_frequency: float
    levels: int
    include_position: bool
    features: Float[Array, "v d"]
    """float32, by base vertex; d may be 0."""
    widths: Int[Array, " layers+1"]
    """int32: inputs of the first layer, then outputs of every layer."""
    parameters: Float[Array, " p"]
    """float32: for every layer the row-major weights (out, in), then the biases (out)."""
    residual: bool
    """Add x to the output, which then has three columns."""


def evaluate_field(
    field: FieldArrays,
    faces: Int[Array, " n"],
    barycentric: Float[Array, "n 3"],
    vertices: Float[Array, "v 3"],
    base_faces: Int[Array, "f 3"],
    threads: int = 1,
) -> Float[Array, "n k"]:
    """The field at points of the base mesh, float32, in the frame of `vertices` (the box frame).

    Laws: rows are independent, so the answer is the same bit for bit for every order, batch and number of threads.

    Raises:
        IndexError: a face index outside `base_faces`, or a corner outside `vertices`.
        ValueError: array shapes do not fit each other.
    """
    answer = np.empty((len(faces), field.widths[-1]), dtype=np.float32)
    rows = np.ascontiguousarray(faces, dtype=np.int32)
    weights = np.ascontiguousarray(barycentric, dtype=np.float64)
    corners = np.ascontiguousarray(base_faces, dtype=np.int32)
    positions = np.ascontiguousarray(vertices, dtype=np.float64)

    def run(start: int, end: int) -> None:
        _field.evaluate(
            answer[start:end],
            rows[start:end],
            weights[start:end],
            positions,
            corners,
            field.features,
            field.widths,
            field.parameters,
            field.base_frequency,
            field.levels,
            field.include_position,
            field.residual,
            INSTRUCTIONS,
        )

    _in_slices(run, len(rows), threads)
    return answer


def evaluate_space_field(field: FieldArrays, points: Float[Array, "n 3"], threads: int = 1) -> Float[Array, "n k"]:
    """The field (without features) at points of the box frame, float32; same laws and errors as `evaluate_field`."""
    answer = np.empty((len(points), field.widths[-1]), dtype=np.float32)
    positions = np.ascontiguousarray(points, dtype=np.float64)

    def run(start: int, end: int) -> None:
        _field.evaluate_space(
            answer[start:end],
            positions[start:end],
            field.widths,
            field.parameters,
            field.base_frequency,
            field.levels,
            field.include_position,
            field.residual,
            INSTRUCTIONS,
        )

    _in_slices(run, len(positions), threads)
    return answer


def _in_slices(run: Callable[[int, int], None], count: int, threads: int) -> None:
    """Call `run(start, end)` over the rows from several threads; the kernels release the interpreter's lock."""
    parts = max(1, min(threads, count // _SLICE))
    if parts == 1:
        return run(0, count)
    bounds = [count * i // parts for i in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(run, bounds[:-1], bounds[1:]))
    return None
