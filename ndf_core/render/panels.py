"""Several pictures as one: a grid with titles, a caption and a colour bar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from ndf_core.render.colormap import ColormapName, colormap
from ndf_core.render.text import draw_text, line_height, text_width, wrap_text

_PADDING = 16
_BAR_WIDTH = 18
_TICKS = 5
_FRAME = (150, 154, 160)


@dataclass(frozen=True)
class ColorBar:
    """The legend of a colour map."""

    vmin: float | int
    vmax: float | int
    label: str
    """What the numbers are, with their unit."""
    name: ColormapName = "viridis"


def panels(
    images: Sequence[UInt8[Array, "_ _ 3"]],
    titles: Sequence[str],
    caption: str = "",
    *,
    columns: int | None = None,
    color_bar: ColorBar | None = None,
    text_size: float | int = 12,
    background: tuple[int, int, int] = (255, 255, 255),
) -> UInt8[Array, "H W 3"]:
    """Put pictures into a grid, row by row, each in the middle of its cell under its title.

    Args:
        images: at least one; they may differ in size.
        titles: one for each, broken into lines where it is wider than its cell; may be empty.
        caption: below the grid, over its whole width.
        columns: pictures in a row; by default all.
        color_bar: to the right of the grid.
        text_size: height of a capital in pixels.

    Raises:
        ValueError: there is no picture, or not one title for each.
    """
    if not images or len(images) != len(titles):
        raise ValueError(f"panels: need at least one picture and a title for each, got {len(images)}, {len(titles)}")
    columns = min(columns or len(images), len(images))
    cell = max(image.shape[1] for image in images)
    rows = [range(start, min(start + columns, len(images))) for start in range(0, len(images), columns)]
    lines = [wrap_text(title, text_size, cell) if title else [] for title in titles]
    step = line_height(text_size)
    heads = [max(len(lines[i]) for i in row) * step for row in rows]
    heights = [max(images[i].shape[0] for i in row) for row in rows]
    grid_width = columns * cell + (columns + 1) * _PADDING
    bar_width = _bar_width(color_bar, text_size) if color_bar else 0
    caption_lines = wrap_text(caption, text_size, grid_width + bar_width - 2 * _PADDING) if caption else []
    tops = np.cumsum([_PADDING, *(head + height + _PADDING for head, height in zip(heads, heights, strict=True))])
    caption_height = len(caption_lines) * step + (_PADDING if caption_lines else 0)
    page = np.empty((int(tops[-1]) + caption_height, grid_width + bar_width, 3), np.uint8)
    page[:] = background
    for row, top, head, height in zip(rows, tops, heads, heights, strict=False):
        for column, i in enumerate(row):
            left = _PADDING + column * (cell + _PADDING)
            _place(page, images[i], left + cell / 2, int(top) + head + height / 2)
            for n, line in enumerate(lines[i]):
                draw_text(page, line, left + cell / 2, int(top) + (n + 0.5) * step, text_size, align=0.5)
    if color_bar:
        _draw_bar(page, color_bar, grid_width, _PADDING + heads[0], heights[0], text_size)
    for n, line in enumerate(caption_lines):
        draw_text(page, line, _PADDING, int(tops[-1]) + (n + 0.5) * step, text_size)
    return page


def _place(page: UInt8[Array, "H W 3"], image: UInt8[Array, "h w 3"], column: float, row: float) -> None:
    height, width = image.shape[:2]
    top, left = round(row - height / 2), round(column - width / 2)
    page[top : top + height, left : left + width] = image


def _tick_labels(bar: ColorBar) -> list[str]:
    """As few digits as tell the ticks apart, so that a narrow range far from zero is not five equal numbers."""
    values = np.linspace(bar.vmin, bar.vmax, _TICKS)
    for digits in range(3, 9):
        labels = [f"{value:.{digits}g}" for value in values]
        if all(one != two for one, two in pairwise(labels)):
            return labels
    return [repr(float(value)) for value in values]


def _bar_width(bar: ColorBar, text_size: float | int) -> int:
    widest = max(text_width(label, text_size) for label in _tick_labels(bar))
    label = max(text_width(line, text_size) for line in bar.label.split("\n"))
    return int(np.ceil(max(_BAR_WIDTH + text_size + widest, label))) + _PADDING


def _draw_bar(
    page: UInt8[Array, "H W 3"], bar: ColorBar, left: int, top: int, height: int, text_size: float | int
) -> None:
    """The label, and below it the bar with the largest value on top, within the height of the first row."""
    step = line_height(text_size)
    lines = bar.label.split("\n")
    for n, line in enumerate(lines):
        draw_text(page, line, left, top + (n + 0.5) * step, text_size)
    first = top + len(lines) * step + step // 2
    last = max(top + height - step // 2, first + 2 * _TICKS)
    last = min(last, len(page) - 1)
    values = np.linspace(bar.vmax, bar.vmin, last - first)
    colors = np.round(colormap(values, bar.vmin, bar.vmax, bar.name) * 255).astype(np.uint8)
    page[first:last, left : left + _BAR_WIDTH] = colors[:, None]
    for edge in (first, last - 1):
        page[edge, left : left + _BAR_WIDTH] = _FRAME
    page[first:last, [left, left + _BAR_WIDTH - 1]] = _FRAME
    for label, row in zip(_tick_labels(bar), np.linspace(last - 1, first, _TICKS), strict=True):
        page[round(row), left + _BAR_WIDTH : left + _BAR_WIDTH + 4] = _FRAME
        draw_text(page, label, left + _BAR_WIDTH + 8, float(row) + 0.5, text_size)
