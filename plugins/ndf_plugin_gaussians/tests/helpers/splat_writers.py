"""Splats to files, written from the formats' descriptions and independently of the readers: one splat at a time where
the readers work on arrays."""

from __future__ import annotations

import gzip
import io
import json
import math
import struct
import zipfile
from pathlib import Path

import numpy as np
import zstandard
from PIL import Image

C0 = 0.5 / math.sqrt(math.pi)


def random_splats(count: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Splats on a unit sphere, flat against it, as plain arrays."""
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    half = normal + np.array([0.0, 0.0, 1.0])  # the rotation that takes z to the normal turns by pi about their mean
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return {
        "centres": normal,
        "scales": np.exp(rng.normal(-3.0, 0.3, (count, 3))) * [1.0, 1.0, 0.1],
        "rotations": np.concatenate([np.zeros((count, 1)), half], axis=1),
        "opacities": rng.uniform(0.3, 0.99, count),
        "colours": rng.uniform(0.1, 0.9, (count, 3)),
    }


def logit(p: float) -> float:
    return math.log(p / (1.0 - p))


def inria(splats: dict[str, np.ndarray], degree: int = 0, stretch: float = 1.0) -> bytes:
    """INRIA .ply with harmonics of `degree`, quaternions `stretch` times as long as unit ones."""
    rest = 3 * ((degree + 1) ** 2 - 1)
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(rest)]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    count = len(splats["centres"])
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    rows = b""
    for i in range(count):
        row = [*splats["centres"][i], 0, 0, 0, *((splats["colours"][i] - 0.5) / C0), *([0.25] * rest)]
        row += [logit(splats["opacities"][i]), *np.log(splats["scales"][i]), *(splats["rotations"][i] * stretch)]
        rows += struct.pack(f"<{len(row)}f", *row)
    return header.encode() + rows


def smallest_three(q: np.ndarray) -> tuple[int, list[float]]:
    """Place of the largest component and the others in order, with the sign that makes the largest positive."""
    largest = int(np.argmax(np.abs(q)))
    sign = 1.0 if q[largest] >= 0 else -1.0
    return largest, [sign * float(q[i]) for i in range(4) if i != largest]


def compressed(splats: dict[str, np.ndarray], colour_ranges: bool) -> bytes:
    """PlayCanvas' compressed .ply, with 12 or 18 columns per chunk."""
    count = len(splats["centres"])
    chunks, rows = b"", b""
    for start in range(0, count, 256):
        part = slice(start, min(start + 256, count))
        logs = np.log(splats["scales"][part])
        where, tint = splats["centres"][part], splats["colours"][part]
        ranges = [where.min(0), where.max(0), logs.min(0), logs.max(0)]
        low, high = (tint.min(0), tint.max(0)) if colour_ranges else (np.zeros(3), np.ones(3))
        if colour_ranges:
            ranges += [low, high]
        chunks += b"".join(struct.pack("<3f", *values) for values in ranges)
        for i in range(part.start, part.stop):

            def word(value: np.ndarray, bottom: np.ndarray, top: np.ndarray) -> int:
                share = (value - bottom) / np.maximum(top - bottom, 1e-12)
                x, y, z = (round(s * m) for s, m in zip(share, (2047, 1023, 2047), strict=True))
                return x << 21 | y << 11 | z

            largest, others = smallest_three(splats["rotations"][i])
            packed = largest
            for value in others:
                packed = packed << 10 | round((value / math.sqrt(2) + 0.5) * 1023)
            share = (splats["colours"][i] - low) / np.maximum(high - low, 1e-12)
            red, green, blue = (round(s * 255) for s in share)
            colour = red << 24 | green << 16 | blue << 8 | round(splats["opacities"][i] * 255)
            position = word(splats["centres"][i], ranges[0], ranges[1])
            scale = word(np.log(splats["scales"][i]), ranges[2], ranges[3])
            rows += struct.pack("<4I", position, packed, scale, colour)
    names = [f"{end}_{axis}" for end in ("min", "max") for axis in "xyz"]
    names += [f"{end}_scale_{axis}" for end in ("min", "max") for axis in "xyz"]
    names += [f"{end}_{channel}" for end in ("min", "max") for channel in "rgb"] if colour_ranges else []
    header = f"ply\nformat binary_little_endian 1.0\nelement chunk {-(-count // 256)}\n"
    header += "".join(f"property float {name}\n" for name in names) + f"element vertex {count}\n"
    header += "".join(f"property uint packed_{name}\n" for name in ("position", "rotation", "scale", "color"))
    return (header + "end_header\n").encode() + chunks + rows


def splat(splats: dict[str, np.ndarray]) -> bytes:
    """.splat"""
    rows = b""
    for i in range(len(splats["centres"])):
        rgba = [round(c * 255) for c in (*splats["colours"][i], splats["opacities"][i])]
        turn = [min(255, round(q * 128 + 128)) for q in splats["rotations"][i]]
        rows += struct.pack("<6f8B", *splats["centres"][i], *splats["scales"][i], *rgba, *turn)
    return rows


def spz(splats: dict[str, np.ndarray], version: int, degree: int = 0) -> bytes:
    """.spz of any version."""
    count, bits = len(splats["centres"]), 12
    streams = [b"", b"", b"", b"", b"", bytes([128]) * (count * (0, 9, 24, 45)[degree])]
    for i in range(count):
        for value in splats["centres"][i]:
            if version == 1:
                streams[0] += struct.pack("<e", value)
            else:
                streams[0] += round(value * (1 << bits)).to_bytes(3, "little", signed=True)
        streams[1] += bytes([round(splats["opacities"][i] * 255)])
        streams[2] += bytes(round(((c - 0.5) / C0 * 0.15 + 0.5) * 255) for c in splats["colours"][i])
        streams[3] += bytes(round((math.log(s) + 10.0) * 16.0) for s in splats["scales"][i])
        w, x, y, z = splats["rotations"][i]
        if version < 3:
            sign = 1.0 if w >= 0 else -1.0
            streams[4] += bytes(round((sign * value + 1.0) * 127.5) for value in (x, y, z))
        else:
            largest, others = smallest_three(np.array([x, y, z, w]))
            word = largest
            for value in others:
                word = word << 10 | (value < 0) << 9 | round(abs(value) * math.sqrt(2) * 511)
            streams[4] += struct.pack("<I", word)
    used = [stream for stream in streams if stream]
    head = struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, bits, 0, len(used) if version == 4 else 0)
    if version < 4:
        return gzip.compress(head + b"".join(streams))
    packed = [zstandard.ZstdCompressor().compress(stream) for stream in used]
    table = b"".join(struct.pack("<QQ", len(a), len(b)) for a, b in zip(packed, used, strict=True))
    return head + struct.pack("<I12x", 32) + table + b"".join(packed)


def picture(pixels: np.ndarray, width: int) -> bytes:
    """Rows of RGBA as a lossless WebP, filled up with zeros."""
    height = -(-len(pixels) // width)
    full = np.zeros((width * height, 4), np.uint8)
    full[: len(pixels)] = pixels
    out = io.BytesIO()
    Image.fromarray(full.reshape(height, width, 4), "RGBA").save(out, "WEBP", lossless=True, exact=True)
    return out.getvalue()


def sog_files(splats: dict[str, np.ndarray], version: int = 2, width: int = 32) -> dict[str, bytes]:
    """meta.json and pictures of a SOG."""
    count = len(splats["centres"])
    signed = np.sign(splats["centres"]) * np.log1p(np.abs(splats["centres"]))
    low, high = signed.min(0), signed.max(0)
    fixed = np.round((signed - low) / (high - low) * 65535).astype(np.int64)
    opaque = np.full((count, 1), 255)
    quats = []
    for q in splats["rotations"]:
        largest, others = smallest_three(q)
        quats.append([*(round((v * math.sqrt(2) + 1) / 2 * 255) for v in others), 252 + largest])
    logs, tint = np.log(splats["scales"]), (splats["colours"] - 0.5) / C0
    meta: dict[str, object] = {"quats": {"files": ["quats.webp"]}}
    meta["means"] = {
        "mins": low.tolist(),
        "maxs": high.tolist(),
        "files": ["means_l.webp", "means_u.webp"],
        "shape": [count, 3],
    }
    if version == 2:
        codes = {"scales": np.linspace(logs.min(), logs.max(), 256), "sh0": np.linspace(tint.min(), tint.max(), 256)}
        meta |= {"version": 2, "count": count}
        for key, book in codes.items():
            meta[key] = {"codebook": book.tolist(), "files": [f"{key}.webp"]}
        scale = np.abs(logs[..., None] - codes["scales"]).argmin(-1)
        colour = np.abs(tint[..., None] - codes["sh0"]).argmin(-1)
        alpha = np.round(splats["opacities"] * 255)[:, None]
    else:
        logits = np.array([logit(a) for a in splats["opacities"]])[:, None]
        four = np.concatenate([tint, logits], axis=1)
        ends = {"scales": (logs.min(0), logs.max(0)), "sh0": (four.min(0), four.max(0))}
        for key, (bottom, top) in ends.items():
            meta[key] = {"mins": bottom.tolist(), "maxs": top.tolist(), "files": [f"{key}.webp"]}
        scale = np.round((logs - ends["scales"][0]) / np.ptp(logs, axis=0) * 255)
        both = np.round((four - ends["sh0"][0]) / np.ptp(four, axis=0) * 255)
        colour, alpha = both[:, :3], both[:, 3:]
    pixels = {
        "means_l.webp": np.concatenate([fixed & 255, opaque], axis=1),
        "means_u.webp": np.concatenate([fixed >> 8, opaque], axis=1),
        "quats.webp": np.array(quats),
        "scales.webp": np.concatenate([scale, opaque], axis=1),
        "sh0.webp": np.concatenate([colour, alpha], axis=1),
    }
    files = {name: picture(values.astype(np.uint8), width) for name, values in pixels.items()}
    return files | {"meta.json": json.dumps(meta).encode()}


def zipped(files: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


def write_folder(files: dict[str, bytes], folder: Path) -> Path:
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder
