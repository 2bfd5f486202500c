"""The ``.ndf`` file: read and write `AssetContent`.

Layout, all integers little-endian:

    magic          6 bytes   89 4E 44 46 0D 0A
    version        uint16    2 where the base mesh has a placement, otherwise 1
    header length  uint32
    header         deflated JSON (`header.py`): what follows, and how large every part is
    codes          the quantised arrays of all fields, range coded (`kernels/codes.py`)
    plain arrays   those kept as float32 or float16, as they are
    base mesh      a Draco blob
    digest         the first 16 bytes of the SHA-256 of everything before it

Fields are in order of their names; their arrays are the features, latent codes where there are any, then weights and
biases layer by layer. The placement of the base mesh comes last.
"""

from __future__ import annotations

import hashlib
import struct
from pathlib import Path

import numpy as np

from ndf_core.asset import limits
from ndf_core.asset.base_mesh_codec import decode_base_mesh
from ndf_core.asset.checks import check_content
from ndf_core.asset.content import AssetContent, FieldBlock, QuantisedArray, Stored
from ndf_core.asset.header import FieldHeader, Header, Layer, Store, pack_header, parse_header
from ndf_core.asset.placement import Placement
from ndf_core.errors import AssetError, InputError
from ndf_core.files import atomic_write
from ndf_core.kernels.codes import decode_codes, encode_codes

FORMAT_VERSION = 2
"""The newest that is read; what has no placement is written as version 1."""
MAGIC = b"\x89NDF\r\n"
_PREFIX = struct.Struct("<6sHI")
_DIGEST_BYTES = 16


def write_asset(content: AssetContent, path: Path | str) -> int:
    """Write `content` atomically and return the number of bytes.

    Raises:
        AssetError: the content contradicts itself.
        OutputError: the folder does not exist or cannot be written to, or `path` is a folder.
    """
    data = asset_bytes(content)
    stored = parse_asset(data)  # a file that cannot be read back, or reads as something else, is never written
    if not (np.array_equal(stored.vertices, content.vertices) and np.array_equal(stored.faces, content.faces)):
        raise AssetError("the asset's base mesh is not what its Draco blob decodes to")
    with atomic_write(path) as file:
        file.write(data)
    return len(data)


def read_asset(path: Path | str) -> AssetContent:
    """Read an asset; nothing in the file is trusted.

    Raises:
        AssetError: truncated, corrupted, written by a newer version, or inconsistent.
        InputError: there is no such file, or it cannot be read.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            data = file.read(limits.FILE_BYTES + 1)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; give an .ndf file that `ndf fit` wrote") from error
    try:
        return parse_asset(data)
    except AssetError as error:
        raise AssetError(f"{path}: {error}") from error


def asset_bytes(content: AssetContent) -> bytes:
    """The file's bytes. Law: equal content gives equal bytes, and `parse_asset` gives back equal content.

    A step is kept as float32, which is all that `QuantisedArray.values` uses of it.

    Raises:
        AssetError: the content contradicts itself.
    """
    body = b"".join(_parts(content).values())
    return body + _digest(body)


def part_bytes(content: AssetContent) -> dict[str, int]:
    """Size of each part of the file, and the total."""
    parts = {name: len(part) for name, part in _parts(content).items()} | {"digest": _DIGEST_BYTES}
    return {**parts, "total": sum(parts.values())}


def format_version(content: AssetContent) -> int:
    """Of the file that holds it."""
    return 1 if content.placement is None else FORMAT_VERSION


def _parts(content: AssetContent) -> dict[str, bytes]:
    """Everything before the digest, in order."""
    check_content(content)
    blocks = [content.fields[name] for name in sorted(content.fields)]
    arrays = [array for block in blocks for array in _arrays(block)]
    placement = content.placement
    if placement is not None:
        arrays.append(QuantisedArray(placement.codes, placement.step))
    codes = encode_codes([_matrix(a.codes) for a in arrays if isinstance(a, QuantisedArray) and a.codes.size])
    plain = b"".join(a.astype(a.dtype.newbyteorder("<")).tobytes() for a in arrays if isinstance(a, np.ndarray))
    header = pack_header(
        Header(
            vertices=len(content.vertices),
            faces=len(content.faces),
            base_mesh_bytes=len(content.base_mesh_blob),
            code_bytes=len(codes),
            center=(float(content.center[0]), float(content.center[1]), float(content.center[2])),
            scale=float(content.scale),
            fields=tuple(_field_header(block) for block in blocks),
            provenance=content.provenance,
            placement=None if placement is None else placement.step,
        )
    )
    return {
        "prefix": _PREFIX.pack(MAGIC, format_version(content), len(header)),
        "header": header,
        "codes": codes,
        "plain_arrays": plain,
        "base_mesh": content.base_mesh_blob,
    }


def parse_asset(data: bytes) -> AssetContent:
    """The content of a file's bytes.

    Raises:
        AssetError: as for `read_asset`, without the path.
    """
    header, body = _open(data)
    shapes = [entry for field in header.fields for entry in field.shapes(header.vertices)]
    if header.placement is not None:
        shapes.append(((header.vertices, 3), header.placement))
    if sum(_size(shape) for shape, _ in shapes) > limits.NUMBERS:
        raise AssetError(f"it holds more than {limits.NUMBERS} numbers, the most that this program reads")
    plain_bytes = sum(_size(shape) * np.dtype(store).itemsize for shape, store in shapes if isinstance(store, str))
    if len(body) != header.code_bytes + plain_bytes + header.base_mesh_bytes:
        raise AssetError("its parts do not add up to its length")
    plain_end = header.code_bytes + plain_bytes
    arrays = _read_arrays(shapes, body[: header.code_bytes], body[header.code_bytes : plain_end])
    blob = body[plain_end:]
    vertices, faces = decode_base_mesh(blob, header.vertices, header.faces)
    content = AssetContent(
        vertices=vertices,
        faces=faces,
        center=np.array(header.center, dtype=np.float64),
        scale=header.scale,
        fields={field.name: _field_block(field, arrays) for field in header.fields},
        provenance=header.provenance,
        base_mesh_blob=blob,
        placement=_placement(arrays),
    )
    check_content(content)
    return content


def _open(data: bytes) -> tuple[Header, bytes]:
    """Check magic, version and digest; return the header and what lies between it and the digest."""
    if len(data) > limits.FILE_BYTES:
        raise AssetError(f"it is larger than {limits.FILE_BYTES >> 20} MiB, the most that this program reads")
    if data[:6] != MAGIC[: len(data)] or not data:
        raise AssetError("it is not an .ndf asset (it does not start like one)")
    damaged = "it is truncated or damaged (its digest does not match); get a new copy"
    if len(data) < _PREFIX.size + _DIGEST_BYTES:
        raise AssetError(damaged)
    _, version, header_length = _PREFIX.unpack_from(data)
    if version > FORMAT_VERSION:
        raise AssetError(
            f"it has format version {version}, and this ndf-core reads versions up to {FORMAT_VERSION}; "
            f"install an ndf-core that reads version {version}"
        )
    body = data[:-_DIGEST_BYTES]
    if _digest(body) != data[-_DIGEST_BYTES:]:
        raise AssetError(damaged)
    end = _PREFIX.size + header_length
    if version < 1 or end > len(body):
        raise AssetError("its header has the wrong length")
    return parse_header(body[_PREFIX.size : end]), body[end:]


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()[:_DIGEST_BYTES]


def _size(shape: tuple[int, ...]) -> int:
    size = 1
    for extent in shape:
        size *= extent
    return size


def _arrays(block: FieldBlock) -> list[Stored]:
    """The arrays of a block in the order of `FieldHeader.shapes`."""
    layers = zip(block.weights, block.biases, strict=True)
    latent = [] if block.latent is None else [block.latent]
    return [block.features, *latent, *(array for layer in layers for array in layer)]


def _matrix(codes: np.ndarray) -> np.ndarray:
    return codes if codes.ndim == 2 else codes[:, None]


def _field_header(block: FieldBlock) -> FieldHeader:
    return FieldHeader(
        name=block.name,
        kind=block.kind,
        domain=block.domain,
        encoding=block.encoding,
        residual=block.residual,
        feature_dim=block.feature_dim,
        features=_store(block.features),
        layers=tuple(
            Layer(len(_plain(biases)), _store(weights), _store(biases))
            for weights, biases in zip(block.weights, block.biases, strict=True)
        ),
        latent=None if block.latent is None else (*block.latent_shape, _store(block.latent)),
        labels=block.labels,
    )


def _plain(array: Stored) -> np.ndarray:
    return array.codes if isinstance(array, QuantisedArray) else array


def _store(array: Stored) -> Store:
    if isinstance(array, QuantisedArray):
        return array.step
    return "float16" if array.dtype == np.float16 else "float32"


def _read_arrays(shapes: list[tuple[tuple[int, ...], Store]], codes: bytes, plain: bytes) -> list[Stored]:
    """The stored arrays, in order; the sizes have been checked."""
    coded = [shape for shape, store in shapes if not isinstance(store, str) and _size(shape)]
    try:
        decoded = iter(decode_codes(codes, [(shape[0], _size(shape[1:])) for shape in coded]))
    except ValueError as error:
        raise AssetError(f"its codes cannot be read ({error})") from error
    arrays: list[Stored] = []
    position = 0
    for shape, store in shapes:
        if isinstance(store, str):
            dtype = np.dtype(store)
            values = np.frombuffer(plain, dtype.newbyteorder("<"), _size(shape), position)
            arrays.append(values.astype(dtype).reshape(shape))
            position += values.nbytes
        else:
            values = next(decoded) if _size(shape) else np.zeros(shape, np.int16)
            arrays.append(QuantisedArray(values.reshape(shape), store))
    return arrays


def _placement(left: list[Stored]) -> Placement | None:
    """From what the fields have left of the arrays."""
    if not left:
        return None
    (array,) = left
    assert isinstance(array, QuantisedArray), "its store is a step"
    return Placement(array.codes, array.step)


def _field_block(field: FieldHeader, arrays: list[Stored]) -> FieldBlock:
    """Take the arrays of one field from the front of the list."""
    first = 1 if field.latent is None else 2
    count = first + 2 * len(field.layers)
    own = arrays[:count]
    del arrays[:count]
    return FieldBlock(
        name=field.name,
        kind=field.kind,  # pyright: ignore[reportArgumentType]  # one of header.KINDS
        domain=field.domain,  # pyright: ignore[reportArgumentType]  # one of header.DOMAINS
        encoding=field.encoding,
        features=own[0],
        weights=tuple(own[first::2]),
        biases=tuple(own[first + 1 :: 2]),
        activation="relu",
        residual=field.residual,
        latent=None if field.latent is None else own[1],
        labels=field.labels,
    )
