"""What a field is learned from: values on a mesh or at points, checked and made numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.errors import InputError

_MOST_COLUMNS = 4096
_LARGEST = 1e15
"""Squares of such values still leave single precision room for sums."""


@dataclass(frozen=True)
class FieldValues:
    """Values of one or more fields on the surface, in the units of the input that the asset was fitted to."""

    points: Array
    """(n, 3): vertices of a mesh of the surface, or points near it."""
    values: Array
    """(n,), (n, k) for k fields or a vector with k components, (n, k, c) for k vectors; or a row for each face.
    Truth values or 0 and 1 for binary fields; whole numbers from 0 on, or texts, for a categorical one."""
    faces: Array | None = None
    """(f, 3): the mesh's triangles; None where `points` are only points."""


@dataclass(frozen=True)
class CheckedValues:
    """Numbers to learn."""

    points: Float[Array, "n 3"]
    faces: Int[Array, "f 3"] | None
    on_faces: bool
    """Whether the rows of `targets` belong to faces."""
    targets: Float[Array, "m k o"]
    """float64: k fields with o components; k classes' indicators (m, 1, k) of a categorical one."""
    labels: tuple[str, ...]
    """The classes' names."""

    def at(self, faces: Int[Array, " n"], weights: Float[Array, "n 3"], continuous: bool) -> Float[Array, "n k o"]:
        """Targets at points of the mesh: linear in triangles if `continuous`, else those of the closest corner."""
        assert self.faces is not None
        if self.on_faces:
            return self.targets[faces]
        corners = self.faces[faces]
        if continuous:
            return np.einsum("nc,ncko->nko", weights, self.targets[corners])
        return self.targets[corners[np.arange(len(corners)), weights.argmax(axis=1)]]


def check_values(given: FieldValues, kind: str, labels: Sequence[str] = ()) -> CheckedValues:
    """Refuse what cannot be learned.

    Args:
        given: as it came.
        kind: "continuous", "binary" or "categorical".
        labels: the classes of a categorical field in order; those that occur where there are none.

    Raises:
        InputError: values that are not finite, of the wrong length or type; a class that never occurs; a mesh whose
            faces name vertices that do not exist.
    """
    points = np.asarray(given.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"field values: need points (n, 3), got {points.shape}")
    if not np.isfinite(points).all():
        lost = int((~np.isfinite(points)).any(axis=1).sum())
        raise InputError(f"field values: {lost:,} of {len(points):,} points are not finite")
    faces = None if given.faces is None else _checked_faces(np.asarray(given.faces), len(points))
    values = np.asarray(given.values)
    on_faces = faces is not None and len(values) == len(faces) != len(points)
    if values.ndim < 1 or values.ndim > 3 or (len(values) != len(points) and not on_faces):
        wanted = f"{len(points):,} points" + ("" if faces is None else f" or {len(faces):,} faces")
        raise InputError(f"field values: got shape {values.shape}, need one row for each of {wanted}")
    if values[0].size == 0 or values[0].size > _MOST_COLUMNS:
        raise InputError(f"field values: {values[0].size} columns; 1 to {_MOST_COLUMNS} can be learned")
    if kind == "categorical":
        targets, names = _classes(values, labels)
    else:
        targets, names = _numbers(values, kind), ()
    return CheckedValues(points, faces, on_faces, targets, names)


def _checked_faces(faces: Array, count: int) -> Int[Array, "f 3"]:
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu" or not len(faces):
        raise InputError(f"field values: need faces (f, 3) of whole numbers, got {faces.dtype} {faces.shape}")
    if faces.min() < 0 or faces.max() >= count:
        raise InputError(f"field values: a face names a vertex that does not exist, of {count:,}")
    return faces.astype(np.int32)


def _numbers(values: Array, kind: str) -> Float[Array, "m k o"]:
    if values.dtype.kind not in "fiub":
        raise InputError(f"field values: of type {values.dtype}; a {kind} field needs numbers")
    numbers = values.astype(np.float64)
    numbers = numbers.reshape(len(numbers), -1, 1) if numbers.ndim < 3 else numbers
    if not np.isfinite(numbers).all():
        bad = np.flatnonzero(~np.isfinite(numbers).all(axis=(1, 2)))
        raise InputError(
            f"field values: {len(bad):,} of {len(numbers):,} rows are not finite, the first is row {bad[0]}"
        )
    if np.abs(numbers).max() > _LARGEST:
        raise InputError(
            f"field values: up to {np.abs(numbers).max():.3g}; at most {_LARGEST:g} fits into single precision"
        )
    if kind == "binary":
        if not np.isin(numbers, (0, 1)).all():
            raise InputError("field values: a binary field needs truth values, or 0 and 1 alone")
        same = (numbers == numbers[:1]).all(axis=0).ravel()
        if same.any():
            column = int(same.argmax())
            raise InputError(
                f"field values: column {column} is {int(numbers[0].ravel()[column])} everywhere; the other class "
                "never occurs, so there is nothing to learn"
            )
    return numbers


def _classes(values: Array, labels: Sequence[str]) -> tuple[Float[Array, "m 1 c"], tuple[str, ...]]:
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1:
        raise InputError(f"field values: a categorical field needs one class per row, got shape {values.shape}")
    if values.dtype.kind in "US":
        names = list(labels) or sorted({str(value) for value in values})
        index = {name: number for number, name in enumerate(names)}
        unknown = next((str(value) for value in values if str(value) not in index), None)
        if unknown is not None:
            raise InputError(f"field values: class {unknown!r:.60} is not among the labels")
        numbers = np.array([index[str(value)] for value in values])
    else:
        with np.errstate(invalid="ignore"):
            if values.dtype.kind not in "fiub" or not (values == np.floor(values)).all() or values.min() < 0:
                raise InputError("field values: classes must be whole numbers from 0 on, or texts")
        if values.max() >= _MOST_COLUMNS:
            raise InputError(f"field values: class {values.max():g}; fewer than {_MOST_COLUMNS} can be learned")
        numbers = values.astype(np.int64)
        names = list(labels) or [str(number) for number in range(int(numbers.max()) + 1)]
        if numbers.max() >= len(names):
            raise InputError(f"field values: class {int(numbers.max())} has no label, of {len(names)}")
    occurs = np.bincount(numbers, minlength=len(names)) > 0
    if not occurs.all():
        raise InputError(
            f"field values: class {names[int(occurs.argmin())]!r} never occurs; number classes without gaps"
        )
    if len(names) < 2:
        raise InputError("field values: there is one class alone, so there is nothing to learn")
    return np.eye(len(names))[numbers][:, None], tuple(names)
