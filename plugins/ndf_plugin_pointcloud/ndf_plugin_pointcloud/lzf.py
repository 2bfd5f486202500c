"""Marc Lehmann's LZF, which compressed PCD files are packed with."""

from __future__ import annotations

_MOST_GROWTH = 132
"""Two bytes never unpack to more than 264."""


def decompress(data: bytes, size: int) -> bytes:
    """Unpack to `size` bytes exactly.

    Raises:
        ValueError: the data is damaged, or cannot unpack to so many bytes.
    """
    if size > _MOST_GROWTH * max(len(data), 1) + 264:
        raise ValueError(f"{len(data):,} packed bytes cannot hold the {size:,} that it announces")
    out = bytearray()
    position, end = 0, len(data)
    try:
        while position < end:
            control = data[position]
            position += 1
            if control < 32:  # that many bytes and one more, as they are
                if position + control + 1 > end:
                    raise IndexError
                out += data[position : position + control + 1]
                position += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[position]
                position += 1
            start = len(out) - ((control & 31) << 8) - data[position] - 1
            position += 1
            if start < 0:
                raise IndexError
            length += 2
            if start + length <= len(out):
                out += out[start : start + length]
            else:  # it runs into what it writes: a period
                period = out[start:]
                out += (period * (length // len(period) + 1))[:length]
            if len(out) > size:
                raise IndexError
    except IndexError:
        raise ValueError("the packed points are damaged") from None
    if len(out) != size:
        raise ValueError(f"the packed points are {len(out):,} bytes, not the {size:,} that it announces")
    return bytes(out)
