"""Text drawn into pictures with the stroke font, antialiased."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from ndf_core.render.strokes import BASELINE, CAP_HEIGHT, GAP, segments

INK = (40, 44, 52)
_PEN = 1.35
"""Width of the pen, in grid units."""
_LINE_HEIGHT = 2.0
"""Of a line of text, in heights of a capital."""


def text_width(text: str, size: float | int) -> float:
    """Width in pixels of one line whose capitals are `size` pixels high."""
    return _advance(text) * size / CAP_HEIGHT


def wrap_text(text: str, size: float | int, width: float | int) -> list[str]:
    """Break text into lines of at most `width` pixels at blanks; a longer word stands alone. Keeps line breaks."""
    lines: list[str] = []
    for paragraph in text.split("\n"):
        line = ""
        for word in paragraph.split(" "):
            longer = f"{line} {word}" if line else word
            if line and text_width(longer, size) > width:
                lines.append(line)
                longer = word
            line = longer
        lines.append(line)
    return lines


def line_height(size: float | int) -> int:
    """Distance in pixels between two lines of text."""
    return round(size * _LINE_HEIGHT)


def draw_text(
    image: UInt8[Array, "h w 3"],
    text: str,
    column: float | int,
    row: float | int,
    size: float | int,
    *,
    align: float | int = 0.0,
    color: tuple[int, int, int] = INK,
) -> None:
    """Draw one line of text into `image`, in place; what falls outside is cut off.

    Args:
        column: pixels; the text's left end, middle or right end for `align` 0, 0.5, 1.
        row: pixels; the middle of the capitals' height.
        size: height of the capitals in pixels.
    """
    scale = size / CAP_HEIGHT
    pen = column - align * text_width(text, size)
    base = row + size / 2
    for character in text:
        # To a quarter of a pixel, so that glyphs are drawn once and reused.
        left, top = int(np.floor(pen)), int(np.floor(base))
        mask = _glyph(character, size, round((pen - left) * 4) / 4, round((base - top) * 4) / 4)
        _blend(image, mask, left - _margin(scale), top - _ascent(scale), color)
        pen += (segments(character)[0] + GAP) * scale


def _advance(text: str) -> int:
    return sum(segments(character)[0] for character in text) + GAP * max(len(text) - 1, 0)


def _margin(scale: float) -> int:
    return int(np.ceil(_PEN * scale)) + 1


def _ascent(scale: float) -> int:
    return int(np.ceil((CAP_HEIGHT + 2) * scale)) + _margin(scale)


@lru_cache(maxsize=512)
def _glyph(character: str, size: float | int, right: float, down: float) -> Float[Array, "h w"]:
    """Coverage of the pixels around a glyph whose origin lies `right` and `down` of a pixel corner."""
    scale = size / CAP_HEIGHT
    width, strokes = segments(character)
    columns = int(np.ceil(width * scale)) + 2 * _margin(scale) + 1
    rows = _ascent(scale) + int(np.ceil(BASELINE * scale)) + _margin(scale) + 1
    if not len(strokes):
        return np.zeros((rows, columns))
    start = np.empty((len(strokes), 2, 2))
    start[..., 0] = strokes[..., 0] * scale + _margin(scale) + right
    start[..., 1] = (BASELINE - strokes[..., 1]) * scale + _ascent(scale) + down
    y, x = np.mgrid[:rows, :columns] + 0.5
    pixels = np.stack([x, y], axis=-1)[:, :, None, :]
    along = start[:, 1] - start[:, 0]
    length = np.maximum((along**2).sum(axis=-1), 1e-12)
    t = np.clip(((pixels - start[:, 0]) * along).sum(axis=-1) / length, 0, 1)
    distance = np.linalg.norm(pixels - start[:, 0] - t[..., None] * along, axis=-1).min(axis=-1)
    half = max(_PEN * scale / 2, 0.5)
    return np.clip(half + 0.5 - distance, 0, 1)


def _blend(
    image: UInt8[Array, "h w 3"], mask: Float[Array, "a b"], left: int, top: int, color: tuple[int, int, int]
) -> None:
    height, width = image.shape[:2]
    first_row, last_row = max(top, 0), min(top + mask.shape[0], height)
    first_column, last_column = max(left, 0), min(left + mask.shape[1], width)
    if first_row >= last_row or first_column >= last_column:
        return
    part = mask[first_row - top : last_row - top, first_column - left : last_column - left, None]
    place = image[first_row:last_row, first_column:last_column]
    place[:] = np.round(place * (1 - part) + np.array(color) * part).astype(np.uint8)
