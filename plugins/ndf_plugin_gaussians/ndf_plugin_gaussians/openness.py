"""From how much of the sky each cell of a grid can be seen, past the cells that block the view.

What is inside of a closed shell is seen from nowhere, whatever holes of a few cells it has: through those only few
directions lead. So openness tells inside from outside where a flood fill would leak.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray as Array

_SLOPES = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Of a ray along the other two axes, per step along the first one: 98 directions in all."""
HIDDEN = 0.1
"""Cells seen from a smaller share of the directions are inside."""
_GROUND_GAIN = 0.05
"""A side is the ground if so much more is inside when nothing is seen from there, as a share of what is anyway."""
_POCKET = 0.35
"""Only cells that are seen from less than this share anyway count: those above a floor are seen from half of it."""

Side = tuple[int, int]
"""Axis, and 1 or -1 for its upper or lower end."""


def openness(blocked: Bool[Array, "x y z"], ground: Side | None = None) -> Float32[Array, "x y z"]:
    """Share of the directions (by solid angle) from which each cell is seen; 0 in cells that block.

    Args:
        blocked: cells that nothing is seen through.
        ground: directions from this side are left out of account.
    """
    seen = np.zeros(blocked.shape, np.float32)
    total = 0.0
    for axis in range(3):
        for sign in (1, -1):
            layers = np.moveaxis(blocked, axis, 0)[::sign]
            target = np.moveaxis(seen, axis, 0)[::sign]
            for slopes in np.ndindex(len(_SLOPES), len(_SLOPES)):
                a, b = (_SLOPES[i] for i in slopes)
                direction = np.insert([a, b], axis, sign)
                if ground is not None and direction[ground[0]] * ground[1] < 0:
                    continue
                # Directions along a diagonal are those of two or three axes. Solid angle of a patch of the cube.
                weight = (1.0 + a * a + b * b) ** -1.5 / (1 + (abs(a) == 1) + (abs(b) == 1))
                _sweep(layers, target, (a, b), weight)
                total += weight
    return seen / np.float32(total)


def _sweep(
    layers: Bool[Array, "n v w"], target: Float32[Array, "n v w"], slopes: tuple[float, float], weight: float
) -> None:
    """Follow parallel rays layer by layer, and add `weight` wherever none is blocked yet."""
    shadow, moved = np.zeros_like(layers[0]), np.zeros_like(layers[0])
    before = (0, 0)
    for n, layer in enumerate(layers):
        at = (int(np.floor(slopes[0] * n + 0.5)), int(np.floor(slopes[1] * n + 0.5)))
        if at != before:
            to, of = zip(*map(_overlap, at, before, layer.shape), strict=True)
            moved[:] = False
            moved[to] = shadow[of]
            shadow, moved = moved, shadow
            before = at
        shadow |= layer
        target[n] += np.float32(weight) * ~shadow


def _overlap(at: int, before: int, size: int) -> tuple[slice, slice]:
    """Where a row of `size` cells, moved from `before` to `at`, comes to lie, and what of it that is."""
    by = at - before
    return slice(max(0, by), size + min(0, by)), slice(max(0, -by), size + min(0, -by))


def find_ground(blocked: Bool[Array, "x y z"]) -> Side | None:
    """The side that an object open underneath stands on; None where no side stands out.

    For each side: how much becomes hidden, in the half next to it, when nothing is seen from there. One must win
    clearly.
    """
    coarse = _halved(blocked)
    whole = openness(coarse)
    inside = coarse | (whole < HIDDEN)
    pocket = ~inside & (whole < _POCKET)
    gains: list[tuple[float, Side]] = []
    for axis in range(3):
        used = np.flatnonzero(np.moveaxis(coarse, axis, 0).any(axis=(1, 2)))
        middle = int(used[0] + used[-1] + 1) // 2 if len(used) else 0
        for sign in (1, -1):
            gained = np.moveaxis(pocket & (openness(coarse, (axis, sign)) < HIDDEN), axis, 0)
            near = gained[middle:] if sign > 0 else gained[:middle]
            gains.append((float(near.sum()) / max(1, int(inside.sum())), (axis, sign)))
    gains.sort(reverse=True)
    return gains[0][1] if gains[0][0] > max(_GROUND_GAIN, 2.0 * gains[1][0]) else None


def _halved(blocked: Bool[Array, "x y z"]) -> Bool[Array, "u v w"]:
    """Blocks of two cells each way; blocked where any of them is."""
    odd = [(0, n % 2) for n in blocked.shape]
    x, y, z = (n + more for n, (_, more) in zip(blocked.shape, odd, strict=True))
    return np.asarray(np.pad(blocked, odd).reshape(x // 2, 2, y // 2, 2, z // 2, 2).any(axis=(1, 3, 5)))


def side_name(side: Side) -> str:
    return f"{'+' if side[1] > 0 else '-'}{'xyz'[side[0]]}"


def parse_side(name: str) -> Side:
    return "xyz".index(name[1]), 1 if name[0] == "+" else -1
