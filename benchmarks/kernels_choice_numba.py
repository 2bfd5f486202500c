"""The two loops of `kernels_choice.py` for numba, in a module of their own so that numba can cache them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy import ndarray as Array


@njit(cache=True, fastmath=True)
def dense(weights: Array, biases: Array, inputs: Array, outputs: Array, relu: bool) -> None:
    rows, columns = weights.shape
    tile = inputs.shape[1]
    for first in range(0, rows, 4):  # four rows share every load of an input
        last = min(first + 4, rows)
        for r in range(first, last):
            for t in range(tile):
                outputs[r, t] = biases[r]
        if last - first == 4:
            for i in range(columns):
                a, b = weights[first, i], weights[first + 1, i]
                c, d = weights[first + 2, i], weights[first + 3, i]
                for t in range(tile):
                    value = inputs[i, t]
                    outputs[first, t] += a * value
                    outputs[first + 1, t] += b * value
                    outputs[first + 2, t] += c * value
                    outputs[first + 3, t] += d * value
        else:
            for r in range(first, last):
                for i in range(columns):
                    for t in range(tile):
                        outputs[r, t] += weights[r, i] * inputs[i, t]
        if relu:
            for r in range(first, last):
                for t in range(tile):
                    outputs[r, t] = max(outputs[r, t], np.float32(0))


@njit(cache=True, fastmath=True)
def field(
    faces: Array, barycentric: Array, vertices: Array, base_faces: Array, features: Array,
    w0: Array, b0: Array, w1: Array, b1: Array, w2: Array, b2: Array,
    answer: Array, frequency: float, levels: int,
) -> None:  # fmt: skip
    tile, count, d = 64, len(faces), features.shape[1]
    x = np.empty((3, tile))
    one = np.empty((w0.shape[1], tile), np.float32)
    two, three = np.empty((len(b0), tile), np.float32), np.empty((len(b1), tile), np.float32)
    out = np.empty((3, tile), np.float32)
    for start in range(0, count, tile):
        for t in range(tile):
            row = min(start + t, count - 1)
            corner = base_faces[faces[row]]
            for c in range(3):
                x[c, t] = 0.0
                for k in range(3):
                    x[c, t] += barycentric[row, k] * vertices[corner[k], c]
            for j in range(d):
                one[3 + 6 * levels + j, t] = 0
                for k in range(3):
                    one[3 + 6 * levels + j, t] += np.float32(barycentric[row, k]) * features[corner[k], j]
        for c in range(3):
            for t in range(tile):
                one[c, t] = x[c, t]
            for level in range(levels):
                scale = frequency * 2.0**level
                for t in range(tile):
                    one[3 + 6 * level + c, t] = np.sin(scale * x[c, t])
                    one[6 + 6 * level + c, t] = np.cos(scale * x[c, t])
        dense(w0, b0, one, two, True)
        dense(w1, b1, two, three, True)
        dense(w2, b2, three, out, False)
        for t in range(min(tile, count - start)):
            for c in range(3):
                answer[start + t, c] = out[c, t] + x[c, t]


@njit(cache=True)
def sort(order: Array, key: Array, vertices: int) -> Array:
    starts = np.zeros(vertices + 1, np.int64)
    for h in order:
        starts[key[h] + 1] += 1
    for v in range(vertices):
        starts[v + 1] += starts[v]
    result = np.empty_like(order)
    for h in order:
        result[starts[key[h]]] = h
        starts[key[h]] += 1
    return result


@njit(cache=True)
def twins_of(faces: Array, vertices: int) -> Array:
    count = 3 * len(faces)
    low, high = np.empty(count, np.int32), np.empty(count, np.int32)
    for h in range(count):
        a, b = faces[h // 3, h % 3], faces[h // 3, (h + 1) % 3]
        low[h], high[h] = min(a, b), max(a, b)
    order = sort(sort(np.arange(count).astype(np.int32), high, vertices), low, vertices)
    twins = np.full(count, -1, np.int32)
    for i in range(count - 1):
        h, g = order[i], order[i + 1]
        if low[h] == low[g] and high[h] == high[g]:
            twins[h], twins[g] = g, h
    return twins
