"""The header of an ``.ndf`` file: what is stored, as JSON, and how large every part is."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ndf_core.asset import limits
from ndf_core.asset.content import Encoding
from ndf_core.asset.values import Values
from ndf_core.errors import AssetError

Store = float | Literal["float32", "float16"]
"""How an array is kept: the step of a quantised one (a float32), or the type of a plain one."""

KINDS = ("displacement", "inverse", "continuous", "binary", "categorical")
DOMAINS = ("base", "space")


@dataclass(frozen=True)
class Layer:
    """One dense layer: number of outputs and how its weights and biases are kept."""

    outputs: int
    weights: Store
    biases: Store


@dataclass(frozen=True)
class FieldHeader:
    """Everything about a field block except its numbers."""

    name: str
    kind: str
    domain: str
    encoding: Encoding
    residual: bool
    feature_dim: int
    features: Store
    layers: tuple[Layer, ...]
    latent: tuple[int, int, Store] | None = None
    """Number and length of the latent codes, and how they are kept."""
    labels: tuple[str, ...] = ()

    def shapes(self, vertices: int) -> list[tuple[tuple[int, ...], Store]]:
        """Shape and store of each array in the order of the file: features, latent codes, weights and biases."""
        arrays: list[tuple[tuple[int, ...], Store]] = [((vertices, self.feature_dim), self.features)]
        inputs = self.encoding.width + self.feature_dim
        if self.latent is not None:
            count, length, store = self.latent
            arrays.append(((count, length), store))
            inputs += length
        for layer in self.layers:
            arrays.append(((layer.outputs, inputs), layer.weights))
            arrays.append(((layer.outputs,), layer.biases))
            inputs = layer.outputs
        return arrays


@dataclass(frozen=True)
class Header:
    """The header, of both format versions."""

    vertices: int
    faces: int
    base_mesh_bytes: int
    code_bytes: int
    center: tuple[float, float, float]
    scale: float
    fields: tuple[FieldHeader, ...]
    provenance: Mapping[str, Any]
    placement: float | None = None
    """Step of the base mesh's placement."""


def pack_header(header: Header) -> bytes:
    """Canonical JSON (sorted keys, no white space), deflated; equal headers give equal bytes.

    Raises:
        AssetError: the provenance holds something that JSON cannot.
    """
    placement = {} if header.placement is None else {"placement": _shortest(header.placement)}
    document = {
        **placement,
        "base_mesh": {
            "codec": "draco",
            "bytes": header.base_mesh_bytes,
            "vertices": header.vertices,
            "faces": header.faces,
        },
        "center": header.center,
        "scale": header.scale,
        "codes": {"codec": "range", "bytes": header.code_bytes},
        "fields": {field.name: _field_document(field) for field in header.fields},
        "provenance": header.provenance,
    }
    try:
        text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise AssetError(f"the asset's provenance cannot be written as JSON: {error}") from error
    if len(text) > limits.HEADER_BYTES:
        raise AssetError(f"the asset's header has {len(text)} bytes, {limits.HEADER_BYTES} are allowed")
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15, 9)
    return deflate.compress(text.encode("ascii")) + deflate.flush()


def _field_document(field: FieldHeader) -> dict[str, Any]:
    encoding = field.encoding
    latent = {} if field.latent is None else {"latent": [*field.latent[:2], _shortest(field.latent[2])]}
    labels = {"labels": list(field.labels)} if field.labels else {}
    return {
        **latent,
        **labels,
        "kind": field.kind,
        "domain": field.domain,
        "encoding": {
            "kind": "periodic",
            "base_frequency": encoding.base_frequency,
            "levels": encoding.levels,
            "include_position": encoding.include_position,
        },
        "activation": "relu",
        "residual": field.residual,
        "features": [field.feature_dim, _shortest(field.features)],
        "layers": [[layer.outputs, _shortest(layer.weights), _shortest(layer.biases)] for layer in field.layers],
    }


def _shortest(store: Store) -> Store:
    """A step as the decimal with the fewest digits that float32 rounds to it; `_parse_store` rounds it back."""
    return store if isinstance(store, str) else float(str(np.float32(store)))


def parse_header(data: bytes) -> Header:
    """Read what `pack_header` wrote; `data` may come from anyone.

    Raises:
        AssetError: not a header, a size beyond `limits`, or a codec, kind or activation that is not known.
    """
    root = Values(_load(data), "header")
    base_mesh = root.object("base_mesh")
    base_mesh.choice("codec", ("draco",))
    codes = root.object("codes")
    codes.choice("codec", ("range",))
    x, y, z = (item.as_number(-1e300, 1e300) for item in root.at("center").entries(3, 3))
    fields = root.object("fields")
    if len(fields.names()) > limits.FIELDS:
        raise AssetError(f"the header lists {len(fields.names())} fields, {limits.FIELDS} are allowed")
    header = Header(
        vertices=base_mesh.integer("vertices", 3, limits.VERTICES),
        faces=base_mesh.integer("faces", 1, limits.FACES),
        base_mesh_bytes=base_mesh.integer("bytes", 1, limits.FILE_BYTES),
        code_bytes=codes.integer("bytes", 0, limits.FILE_BYTES),
        center=(x, y, z),
        scale=root.number("scale", 1e-300, 1e300),
        fields=tuple(_parse_field(name, fields.object(name)) for name in fields.names()),
        provenance=root.mapping("provenance"),
        placement=float(np.float32(root.number("placement", *limits.STEP))) if "placement" in root.names() else None,
    )
    for part in (root, base_mesh, codes):
        part.close()
    return header


def _load(data: bytes) -> Any:
    """Inflate and parse, both bounded."""
    inflate = zlib.decompressobj(-15)
    try:
        text = inflate.decompress(data, limits.HEADER_BYTES + 1)
        if len(text) > limits.HEADER_BYTES or not inflate.eof or inflate.unused_data:
            raise AssetError("its header has the wrong length")
        return json.loads(text.decode("ascii"))
    except (zlib.error, ValueError, RecursionError) as error:
        raise AssetError(f"its header cannot be read ({error})") from error


def _parse_field(name: str, values: Values) -> FieldHeader:
    if not (name.isidentifier() and name.isascii() and len(name) <= 64):
        raise AssetError(f"the header names a field {name[:80]!r}; names are identifiers of at most 64 characters")
    encoding = values.object("encoding")
    encoding.choice("kind", ("periodic",))
    values.choice("activation", ("relu",))
    feature_dim, features = values.at("features").entries(2, 2)
    layers = [layer.entries(3, 3) for layer in values.at("layers").entries(1, limits.LAYERS)]
    latent = values.at("latent").entries(3, 3) if "latent" in values.names() else None
    labels = values.at("labels").entries(1, limits.WIDTH) if "labels" in values.names() else []
    field = FieldHeader(
        name=name,
        kind=values.choice("kind", KINDS),
        domain=values.choice("domain", DOMAINS),
        encoding=Encoding(
            base_frequency=encoding.number("base_frequency", 1e-30, limits.FREQUENCY),
            levels=encoding.integer("levels", 0, limits.LEVELS),
            include_position=encoding.boolean("include_position"),
        ),
        residual=values.boolean("residual"),
        feature_dim=feature_dim.as_integer(0, limits.FEATURE_DIM),
        features=_parse_store(features),
        layers=tuple(
            Layer(outputs.as_integer(1, limits.WIDTH), _parse_store(weights), _parse_store(biases))
            for outputs, weights, biases in layers
        ),
        latent=None if latent is None else _parse_latent(*latent),
        labels=tuple(label.as_text(limits.LABEL) for label in labels),
    )
    values.close()
    encoding.close()
    return field


def _parse_latent(count: Values, length: Values, store: Values) -> tuple[int, int, Store]:
    return count.as_integer(1, limits.WIDTH), length.as_integer(1, limits.FEATURE_DIM), _parse_store(store)


def _parse_store(value: Values) -> Store:
    if isinstance(value.value, str):
        return value.as_choice(("float32", "float16"))  # pyright: ignore[reportReturnType]  # one of the two
    return float(np.float32(value.as_number(*limits.STEP)))
