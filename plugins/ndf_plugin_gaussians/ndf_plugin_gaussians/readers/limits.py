"""Sizes beyond which a file is refused before anything is allocated for it."""

from __future__ import annotations

MOST_BYTES = 4 << 30
MOST_SPLATS = 50_000_000
"""Some 6 GB as float64."""
MOST_PIXELS = 4 * MOST_SPLATS
"""Of all pictures of a .sog file together."""


def check_count(count: int) -> None:
    """Refuse counts that no real file has.

    Raises:
        ValueError: `count` is zero or too large.
    """
    if not 0 < count <= MOST_SPLATS:
        raise ValueError(f"it announces {count:,} splats; between 1 and {MOST_SPLATS:,} can be read")
