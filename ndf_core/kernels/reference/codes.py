"""The range coder of `kernels.codes` in plain Python integers, one code at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Int
from numpy import ndarray as Array

TOTAL_BITS = 18
TOTAL = 1 << TOTAL_BITS
TOP = 1 << 24


def _half_logistic() -> list[int]:
    """2^31 (logistic(j / 16) - 1/2) for j = 0 .. 256."""
    power, halves = 1 << 32, list[int]()
    for _ in range(257):
        halves.append((1 << 63) // ((1 << 32) + power) - (1 << 30))
        power = power * 4034748382 >> 32
    return halves


HALF = _half_logistic()


class Model:
    """A discretised logistic distribution over TOTAL slots; the last slot is the escape."""

    def __init__(self, total: int, count: int) -> None:
        total = max(total, 2 * count)
        self.inverse = 726817 * 16 * count // total
        self.reach = min(8 * total // (16 * count) + 15, 32768)

    def slots_below(self, code: int) -> int:
        if code <= -self.reach:
            return 0
        if code > self.reach:
            return TOTAL - 1
        edge = 2 * code - 1
        index, fraction = divmod(abs(edge) * self.inverse, 1 << 16)
        half = HALF[-1] if index >= 256 else HALF[index] + ((HALF[index + 1] - HALF[index]) * fraction >> 16)
        below = (1 << 30) + (half if edge > 0 else -half)
        return (below * (TOTAL - 2 * self.reach - 2) >> 31) + code + self.reach


def models(columns: int, mean: int) -> Iterator[tuple[Model, list[int], int]]:
    """For each code in row-major order: its model, the columns' sums (to be added to) and its column."""
    sums = [4 * mean] * columns
    row = 0
    while True:
        for column in range(columns):
            yield Model(sums[column], 4 + row), sums, column
        row += 1


def encode_codes(arrays: Sequence[Int[Array, "rows columns"]]) -> bytes:
    """Interval arithmetic without carries: the whole stream is one long integer `low`."""
    low, span, digits = 0, (1 << 32) - 1, 4

    def narrow(below: int, slots: int, bits: int) -> None:
        nonlocal low, span, digits
        span >>= bits
        low += below * span
        span *= slots
        while span < TOP:
            span, low, digits = span << 8, low << 8, digits + 1

    for array in arrays:
        codes = array.astype(int).ravel()
        shift = 0
        while (mean := -(-int(np.abs(codes >> shift).sum()) * 16 // codes.size)) > 128 * 16:
            shift += 1
        narrow(shift, 1, 4)
        narrow(mean, 1, 12)
        for value, (model, sums, column) in zip(codes.tolist(), models(array.shape[1], mean), strict=False):
            code = value >> shift
            if abs(code) > model.reach:
                narrow(TOTAL - 1, 1, TOTAL_BITS)
                narrow(code + 32768, 1, 16)
            else:
                below = model.slots_below(code)
                narrow(below, model.slots_below(code + 1) - below, TOTAL_BITS)
            if shift:
                narrow(value & ((1 << shift) - 1), 1, shift)
            sums[column] += 16 * abs(code)
    low = -(-low // TOP) * TOP
    data = low.to_bytes(digits, "big")
    return data[:-4] + data[-4:].rstrip(b"\0")
