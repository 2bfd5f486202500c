"""Niantic's .spz: attributes one after the other, as one gzip stream (versions 1 to 3) or a zstd stream each (4).

Reference: https://github.com/nianticlabs/spz
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np
import zstandard
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from ndf_plugin_gaussians.detect import SPZ_MAGIC
from ndf_plugin_gaussians.readers.limits import check_count
from ndf_plugin_gaussians.readers.smallest_three import from_smallest_three
from ndf_plugin_gaussians.splats import SH_C0, Splats, make_splats

_HEADER = struct.Struct("<4sIIBBBB")
_HEADER_4 = 32
"""Bytes of version 4's header, which is not compressed."""
_COLOUR_SCALE = 0.15
_HARMONICS = (0, 9, 24, 45, 72)
"""Bytes per splat of the higher harmonics, by degree."""


@dataclass(frozen=True)
class _Header:
    version: int
    count: int
    degree: int
    fractional_bits: int
    streams: int

    @property
    def widths(self) -> tuple[int, ...]:
        """Bytes per splat: positions, opacities, colours, scales, rotations, higher harmonics."""
        return (6 if self.version == 1 else 9, 1, 3, 3, 3 if self.version < 3 else 4, _HARMONICS[self.degree])


def read_spz(data: bytes) -> tuple[Splats, int]:
    """Splats, and the number of those left out as not finite.

    Raises:
        ValueError: the file is cut off, of an unknown version, or holds less or more than its header says.
    """
    header, streams = _version_4(data) if data.startswith(SPZ_MAGIC) else _gzipped(data)
    position, opacity, colour, scale, rotation = (stream.reshape(header.count, -1) for stream in streams[:5])
    return make_splats(
        centres=_positions(position, header),
        log_scales=scale / 16.0 - 10.0,
        quaternions=_rotations(rotation),
        opacities=opacity[:, 0] / 255.0,
        colours=0.5 + SH_C0 / _COLOUR_SCALE * (colour / 255.0 - 0.5),
    )


def _gzipped(data: bytes) -> tuple[_Header, list[UInt8[Array, " _"]]]:
    """One stream: a header of 16 bytes, then all attributes."""
    unpacker = zlib.decompressobj(wbits=31)
    try:
        header = _header(unpacker.decompress(data, _HEADER.size), (1, 2, 3))
        size = header.count * sum(header.widths)
        body = unpacker.decompress(unpacker.unconsumed_tail, size)
        more = unpacker.decompress(unpacker.unconsumed_tail, 1)
    except zlib.error as error:
        raise ValueError(f"its gzip stream is damaged or no gzip ({error})") from error
    if len(body) == size and (more or not unpacker.eof):
        raise ValueError(f"its gzip stream {'goes on after' if more else 'is cut off at the end of'} its splats")
    return header, _split(np.frombuffer(body, np.uint8), header)


def _split(body: UInt8[Array, " b"], header: _Header) -> list[UInt8[Array, " _"]]:
    sizes = [header.count * width for width in header.widths]
    if len(body) != sum(sizes):
        raise ValueError(f"{header.count:,} splats need {sum(sizes):,} bytes, it holds {len(body):,}")
    return np.split(body, np.cumsum(sizes)[:-1])


def _version_4(data: bytes) -> tuple[_Header, list[UInt8[Array, " _"]]]:
    """A header, a table of (compressed, uncompressed) sizes where the header says, and the streams after it."""
    header = _header(data, (4,))
    if len(data) < _HEADER_4:
        raise ValueError("it ends inside its header")
    table = int.from_bytes(data[16:20], "little")
    expected = [header.count * width for width in header.widths if width]
    position = table + 16 * len(expected)
    if header.streams != len(expected) or table < _HEADER_4 or position > len(data):
        raise ValueError(f"its table of {header.streams} streams at byte {table} does not fit the file")
    streams: list[UInt8[Array, " _"]] = []
    for i, size in enumerate(expected):
        packed, unpacked = struct.unpack_from("<QQ", data, table + 16 * i)
        if unpacked != size or position + packed > len(data):
            raise ValueError(f"its stream {i} announces {packed:,} bytes for {unpacked:,}; {size:,} are needed")
        streams.append(_unzstd(data[position : position + packed], size))
        position += packed
    return header, streams


def _unzstd(packed: bytes, size: int) -> UInt8[Array, " b"]:
    """Exactly `size` bytes; more are not unpacked. The window is bounded too: a frame may ask for gigabytes."""
    try:
        with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(packed) as reader:
            body = reader.read(size)
    except zstandard.ZstdError as error:
        raise ValueError(f"a zstd stream of it is damaged ({error})") from error
    if len(body) != size:
        raise ValueError(f"a zstd stream of it holds {len(body):,} bytes, {size:,} are needed")
    return np.frombuffer(body, np.uint8)


def _header(data: bytes, versions: tuple[int, ...]) -> _Header:
    if len(data) < _HEADER.size:
        raise ValueError("it ends inside its header")
    magic, version, count, degree, fractional_bits, _, streams = _HEADER.unpack_from(data)
    if magic != SPZ_MAGIC:
        raise ValueError(f"it begins with {magic!r}, not with {SPZ_MAGIC!r}")
    if version not in versions:
        raise ValueError(f"version {version} of the format is not known here (1 to 4 are)")
    if degree >= len(_HARMONICS) or fractional_bits > 30:
        raise ValueError(f"harmonics of degree {degree} with {fractional_bits} fractional bits are not possible")
    check_count(count)
    return _Header(version, count, degree, fractional_bits, streams)


def _positions(stream: UInt8[Array, "n k"], header: _Header) -> Float[Array, "n 3"]:
    """Half floats in version 1, afterwards fixed point numbers of 24 bits with a sign."""
    if header.version == 1:
        return np.ascontiguousarray(stream).view("<f2").astype(np.float64)
    parts = stream.reshape(-1, 3, 3).astype(np.int64)
    fixed = parts[:, :, 0] | parts[:, :, 1] << 8 | parts[:, :, 2] << 16
    return (fixed - ((fixed >> 23) << 24)) / float(1 << header.fractional_bits)


def _rotations(stream: UInt8[Array, "n k"]) -> Float[Array, "n 4"]:
    """x, y, z as bytes, w the rest of the unit length; from version 3 on the smallest three of x, y, z, w as sign and
    nine bits, the last one lowest, and the place of the largest above them."""
    if stream.shape[1] == 3:
        vector = stream / 127.5 - 1.0
        w = np.sqrt(np.maximum(0.0, 1.0 - (vector**2).sum(axis=1)))
        return np.concatenate([w[:, None], vector], axis=1)
    word = np.ascontiguousarray(stream).view("<u4")[:, 0].astype(np.int64)
    parts = np.stack([word >> shift & 1023 for shift in (20, 10, 0)], axis=1)
    size = (parts & 511) / 511 * np.sqrt(0.5)
    return from_smallest_three(np.where(parts >> 9, -size, size), word >> 30)[:, [3, 0, 1, 2]]
