"""A small stroke font of our own: glyphs as pen strokes, so that text is smooth at any size without a font file.

A point is two characters of base 36, x then y. The baseline is y = 4, small letters reach y = 12 (c), capitals y = 16
(g), descenders y = 0. Strokes are separated by blanks; `~` marks a smooth curve through its end points, `@` a smooth
closed curve. One point alone is a dot.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

CAP_HEIGHT = 12
"""From the baseline to the top of capitals and digits, in grid units."""
BASELINE = 4
GAP = 4
"""Between two glyphs' boxes."""

GLYPHS: dict[str, tuple[int, str]] = {
    " ": (2, ""),
    "A": (8, "044g84 1878"),
    "B": (8, "040g ~0g3g7g7a3a0a ~0a4a8a844404"),
    "C": (8, "~8e7g4g0g0a04447486"),
    "D": (8, "040g ~0g3g8g8a843404"),
    "E": (7, "7g0g0474 0a6a"),
    "F": (7, "7g0g04 0a6a"),
    "G": (8, "~8e7g4g0g0a0444848a 8a5a"),
    "H": (8, "040g 848g 0a8a"),
    "I": (0, "040g"),
    "J": (6, "~6g6864340407"),
    "K": (8, "040g 8g09 3b84"),
    "L": (7, "0g0474"),
    "M": (10, "040g57aga4"),
    "N": (8, "040g848g"),
    "O": (9, "@040g9g94"),
    "P": (8, "040g ~0g4g8g894909"),
    "Q": (9, "@040g9g94 5893"),
    "R": (8, "040g ~0g4g8g894909 4984"),
    "S": (8, "~7e7g4g0g0b4a8984440406"),
    "T": (8, "0g8g 4g44"),
    "U": (8, "~0g0a0444848a8g"),
    "V": (8, "0g448g"),
    "W": (12, "0g346g94cg"),
    "X": (8, "048g 0g84"),
    "Y": (8, "0g4a8g 4a44"),
    "Z": (8, "0g8g0484"),
    "a": (7, "@040c7c74 7c74"),
    "b": (7, "0g04 @040c7c74"),
    "c": (6, "~6a6c3c0c04346466"),
    "d": (7, "7g74 @040c7c74"),
    "e": (7, "0878 ~787c0c04446466"),
    "f": (5, "~5g2g2d24 0c5c"),
    "g": (7, "7c75 @040c7c74 ~7571702002"),
    "h": (7, "0g04 ~080c7c7874"),
    "i": (0, "040c 0g"),
    "j": (3, "~3c33302000 3g"),
    "k": (6, "0g04 6c07 2964"),
    "l": (0, "0g04"),
    "m": (10, "040c ~080c5c5854 ~585caca8a4"),
    "n": (7, "040c ~080c7c7874"),
    "o": (7, "@040c7c74"),
    "p": (7, "0c00 @040c7c74"),
    "q": (7, "7c70 @040c7c74"),
    "r": (5, "040c ~080b2c5c"),
    "s": (6, "~6a6c3c0c096764340406"),
    "t": (5, "~2g262454 0c5c"),
    "u": (7, "~0c08047478 7c74"),
    "v": (8, "0c448c"),
    "w": (10, "0c345b74ac"),
    "x": (7, "047c 0c74"),
    "y": (8, "0c44 8c20"),
    "z": (7, "0c7c0474"),
    "0": (8, "@040g8g84"),
    "1": (8, "1d4g44"),
    "2": (8, "~0d0g4g8g8b5804 0484"),
    "3": (8, "~0e1g4g7g7b3a ~3a8a84440406"),
    "4": (8, "646g0888"),
    "5": (8, "7g1g0a ~0a2c8c84440406"),
    "6": (8, "@040c8c84 ~7f6g4g0g08"),
    "7": (8, "0g8g34"),
    "8": (8, "@1a1g7g7a @040a8a84"),
    "9": (8, "@080g8g88 ~152444848c"),
    ".": (0, "04"),
    ",": (1, "1502"),
    ":": (0, "04 0b"),
    ";": (1, "1b 1502"),
    "!": (0, "080g 04"),
    "?": (7, "~0d0g3g7g7b3b38 34"),
    "'": (0, "0d0g"),
    '"': (3, "0d0g 3d3g"),
    "`": (2, "0g2d"),
    "-": (5, "0959"),
    "–": (8, "0989"),
    "−": (8, "0989"),
    "_": (8, "0282"),
    "+": (8, "0989 454d"),
    "=": (8, "0787 0b8b"),
    "±": (8, "0a8a 464e 0484"),
    "×": (6, "066c 0c66"),
    "*": (6, "383e 096d 0d69"),
    "/": (6, "026g"),
    "\\": (6, "0g62"),
    "|": (0, "000g"),
    "(": (3, "~3g0d0531"),
    ")": (3, "~0g3d3501"),
    "[": (3, "3g0g0131"),
    "]": (3, "0g3g3101"),
    "{": (4, "~4g1g2a08 ~08271141"),
    "}": (4, "~0g3g2a48 ~48273101"),
    "<": (7, "7d0873"),
    ">": (7, "0d7803"),
    "%": (11, "04bg @0b0g4g4b @7479b9b4"),
    "#": (8, "142g 647g 0888 0c8c"),
    "$": (8, "~7e7g4g0g0b4a8984440406 4i42"),
    "&": (9, "~942b2g6g6c0a046489"),
    "^": (6, "0c3g6c"),
    "~": (8, "~080b3b58888b"),
    "@": (11, "@363c8c86 ~8c8666b7bg0g0404a4"),
    "°": (3, "@0d0g3g3d"),
    "µ": (7, "0c00 ~0c08047478 7c74"),
    "→": (10, "08a8 6ba865"),
}
"""Width and strokes of each character, in grid units."""

UNKNOWN = (7, "040g7g7404")
"""The empty box in place of a character that the font does not have."""


@cache
def segments(character: str) -> tuple[int, Float[Array, "n 2 2"]]:
    """A glyph's width and its pen strokes as straight segments, in grid units above the descender."""
    width, strokes = GLYPHS.get(character, UNKNOWN)
    parts = [_segments_of(stroke) for stroke in strokes.split()]
    return width, np.concatenate(parts) if parts else np.zeros((0, 2, 2))


def _segments_of(stroke: str) -> Float[Array, "n 2 2"]:
    digits = stroke.lstrip("~@")
    points = np.array([[int(digits[i], 36), int(digits[i + 1], 36)] for i in range(0, len(digits), 2)], dtype=float)
    closed = stroke[0] == "@"
    if closed or stroke[0] == "~":
        for _ in range(4):
            points = _cut_corners(points, closed)
    if closed or len(points) == 1:
        points = np.concatenate([points, points[:1]])
    return np.stack([points[:-1], points[1:]], axis=1)


def _cut_corners(points: Float[Array, "n 2"], closed: bool) -> Float[Array, "m 2"]:
    """One round of Chaikin's subdivision, whose limit is the quadratic B-spline; open curves keep their ends."""
    following = np.roll(points, -1, axis=0)
    cut = np.stack([0.75 * points + 0.25 * following, 0.25 * points + 0.75 * following], axis=1)
    if closed:
        return cut.reshape(-1, 2)
    return np.concatenate([points[:1], cut[:-1].reshape(-1, 2)[1:-1], points[-1:]])
