"""The ``.ndf`` file: round trips, canonical bytes, and files that are damaged or lie."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_assets import icosphere, open_grid, small_content, torus

from ndf_core.asset import limits
from ndf_core.asset.content import AssetContent, FieldBlock, QuantisedArray, values_of
from ndf_core.asset.file import asset_bytes, parse_asset, part_bytes, read_asset, write_asset
from ndf_core.asset.placement import Placement
from ndf_core.errors import AssetError, FitError, InputError, OutputError
from ndf_core.mesh import face_normals

MESHES = {"sphere": icosphere(1), "torus": torus(), "open": open_grid()}


def arrays_of(block: FieldBlock) -> list[Any]:
    return [block.features, *block.weights, *block.biases]


def assert_equal(one: AssetContent, two: AssetContent) -> None:
    np.testing.assert_array_equal(one.vertices, two.vertices)
    np.testing.assert_array_equal(one.faces, two.faces)
    np.testing.assert_array_equal(one.center, two.center)
    assert one.scale == two.scale
    assert one.base_mesh_blob == two.base_mesh_blob
    assert one.provenance == two.provenance
    assert set(one.fields) == set(two.fields)
    for name, block in one.fields.items():
        other = two.fields[name]
        for attribute in ("name", "kind", "domain", "encoding", "activation", "residual"):
            assert getattr(block, attribute) == getattr(other, attribute)
        for mine, theirs in zip(arrays_of(block), arrays_of(other), strict=True):
            assert type(mine) is type(theirs)
            if isinstance(mine, QuantisedArray):
                assert mine.step == theirs.step
                assert mine.codes.dtype == theirs.codes.dtype
            else:
                assert mine.dtype == theirs.dtype
            np.testing.assert_array_equal(values_of(mine), values_of(theirs))


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("quantised", [True, False])
def test_round_trip_is_exact(mesh: str, quantised: bool, tmp_path: Path) -> None:
    content = small_content(
        MESHES[mesh], quantised=quantised, center=(1e6 + 1 / 3, -2.0, 1e-9), scale=1e-6 / 3, inverse=mesh != "open"
    )
    size = write_asset(content, tmp_path / "a.ndf")
    assert size == (tmp_path / "a.ndf").stat().st_size == part_bytes(content)["total"]
    again = read_asset(tmp_path / "a.ndf")
    assert_equal(content, again)
    assert asset_bytes(again) == (tmp_path / "a.ndf").read_bytes()


def test_half_precision_and_no_features() -> None:
    content = small_content(feature_dim=0, quantised=False)
    block = content.fields["displacement"]
    block = dataclasses.replace(block, weights=tuple(w.astype(np.float16) for w in block.weights))
    content = dataclasses.replace(content, fields={"displacement": block})
    assert_equal(content, parse_asset(asset_bytes(content)))


def test_a_step_beyond_float32_keeps_its_values() -> None:
    content = small_content()
    block = content.fields["displacement"]
    assert isinstance(block.features, QuantisedArray)
    features = QuantisedArray(block.features.codes, 0.0123456789012345)
    content = dataclasses.replace(content, fields={"displacement": dataclasses.replace(block, features=features)})
    again = parse_asset(asset_bytes(content)).fields["displacement"].features
    np.testing.assert_array_equal(values_of(again), features.values)


def test_equal_content_gives_equal_bytes() -> None:
    one, two = small_content(), small_content()
    two = dataclasses.replace(
        two,
        fields=dict(reversed(two.fields.items())),
        provenance=dict(reversed(two.provenance.items())),
        vertices=two.vertices.copy(order="F"),
    )
    assert asset_bytes(one) == asset_bytes(two)


def test_header_of_the_paper_sized_asset_is_small() -> None:
    """Two networks of 2 x 64 with 8 levels and d = 16: everything but codes and base mesh in 600 bytes."""
    content = small_content(torus(50, 20), feature_dim=16, width=64, levels=8)
    parts = part_bytes(content)
    assert parts["total"] - parts["codes"] - parts["base_mesh"] <= 600


def placed_content() -> AssetContent:
    """The small sphere's base mesh, on an egg."""
    content = small_content()
    return dataclasses.replace(content, placement=Placement.of(content.vertices * [1.0, 0.7, 0.5], content.faces))


def test_a_placement_makes_it_version_2() -> None:
    content = placed_content()
    data, plain = asset_bytes(content), asset_bytes(small_content())
    assert (data[6], plain[6]) == (2, 1)
    again = parse_asset(data)
    assert_equal(content, again)
    assert again.placement is not None
    assert asset_bytes(again) == data
    np.testing.assert_array_equal(again.placed, content.placed)
    np.testing.assert_allclose(again.placed, content.vertices * [1.0, 0.7, 0.5], atol=3 / 8191 / 2 + 1e-9)


def test_placed_triangles_have_areas() -> None:
    """All vertices but four lie on one straight line, or all at one place."""
    points, faces = icosphere(1)
    points[4:] = np.linspace(-1, 1, len(points) - 4)[:, None] * [1.0, 0.0, 0.0]
    placed = Placement.of(points, faces).positions
    assert face_normals(placed, faces).any(axis=1).all()
    assert np.abs(placed - points).max() < 0.01
    assert Placement.of(0 * points, faces).positions.any(), "the sphere is made of a few steps"


def test_a_placement_far_outside_is_refused() -> None:
    content = placed_content()
    with pytest.raises(FitError, match="far outside"):
        Placement.of(content.vertices * 1e3, content.faces)
    assert content.placement is not None
    far = dataclasses.replace(content, placement=Placement(content.placement.codes, 10.0))
    with pytest.raises(AssetError, match=r"placed up to .* from the middle"):
        asset_bytes(far)
    flat = dataclasses.replace(content, placement=Placement(0 * content.placement.codes))
    with pytest.raises(AssetError, match="placed up to 0 from the middle"):
        asset_bytes(flat)
    short = dataclasses.replace(content, placement=Placement(content.placement.codes[1:]))
    with pytest.raises(AssetError, match=r"placement has shape \(41, 3\) for 42"):
        asset_bytes(short)
    with pytest.raises(AssetError, match="placed up to"):
        parse_asset(repack(asset_bytes(content), set_at("placement", value=1e20), version=2))
    with pytest.raises(AssetError, match="do not end"):
        parse_asset(repack(asset_bytes(small_content()), set_at("placement", value=1e-3), version=2))


def repack(
    data: bytes, change: Callable[[dict[str, Any]], None] | None = None, insert: bytes = b"", version: int = 1
) -> bytes:
    """The file with a changed header or `insert` before its blobs, and a digest that matches."""
    length = struct.unpack_from("<I", data, 8)[0]
    header = json.loads(zlib.decompress(data[12 : 12 + length], -15))
    if change is not None:
        change(header)
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = deflate.compress(json.dumps(header).encode()) + deflate.flush()
    body = data[:6] + struct.pack("<HI", version, len(packed)) + packed + insert + data[12 + length : -16]
    return body + hashlib.sha256(body).digest()[:16]


def test_repacking_alone_changes_nothing() -> None:
    content = small_content()
    assert_equal(parse_asset(repack(asset_bytes(content))), content)


def test_truncated_anywhere() -> None:
    data = asset_bytes(small_content())
    for end in {*range(80), *(len(data) * part // 20 for part in range(20)), len(data) - 1}:
        with pytest.raises(AssetError, match="truncated or damaged|not an .ndf asset"):
            parse_asset(data[:end])


def test_any_flipped_byte() -> None:
    data = asset_bytes(small_content())
    rng = np.random.default_rng(0)
    for position in {*range(16), *rng.integers(0, len(data), size=200).tolist()}:
        damaged = bytearray(data)
        damaged[position] ^= int(rng.integers(1, 256))
        with pytest.raises(AssetError):
            parse_asset(bytes(damaged))


def test_flipped_bytes_under_a_matching_digest_never_crash() -> None:
    """A forger can make anything decode; it must be an AssetError or consistent content."""
    data = asset_bytes(small_content())
    rng = np.random.default_rng(1)
    for position in rng.integers(12, len(data) - 16, size=300).tolist():
        damaged = bytearray(data)
        damaged[position] ^= int(rng.integers(1, 256))
        forged = bytes(damaged[:-16])
        try:
            content = parse_asset(forged + hashlib.sha256(forged).digest()[:16])
        except AssetError:
            continue
        assert np.isfinite(content.vertices).all()
        assert content.faces.max() < len(content.vertices)


def test_newer_version_says_what_it_needs() -> None:
    with pytest.raises(AssetError, match=r"format version 7, .* reads versions up to 2; install"):
        parse_asset(repack(asset_bytes(small_content()), version=7))


def set_at(*path: str | int, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(header: Any) -> None:
        for key in path[:-1]:
            header = header[key]
        header[path[-1]] = value

    return change


def delete(*path: str) -> Callable[[dict[str, Any]], None]:
    def change(header: Any) -> None:
        for key in path[:-1]:
            header = header[key]
        del header[path[-1]]

    return change


FIELD = ("fields", "displacement")
LIES: dict[str, tuple[Callable[[dict[str, Any]], None], str]] = {
    "more vertices": (set_at("base_mesh", "vertices", value=43), "do not end"),
    "billions of vertices": (set_at("base_mesh", "vertices", value=10**12), "base_mesh.vertices is not an integer"),
    "most vertices": (set_at("base_mesh", "vertices", value=limits.VERTICES), "do not end"),
    "more faces": (set_at("base_mesh", "faces", value=81), "80 faces where|decoded"),
    "boolean count": (set_at("base_mesh", "faces", value=True), "faces is not an integer"),
    "text for a count": (set_at("base_mesh", "faces", value="80"), "faces is not an integer"),
    "codes longer": (set_at("codes", "bytes", value=10_000), "add up"),
    "codes shorter": (set_at("codes", "bytes", value=3), "add up"),
    "other base mesh codec": (set_at("base_mesh", "codec", value="wavelet"), "'wavelet'.*draco"),
    "other code": (set_at("codes", "codec", value="zstd"), "'zstd'.*range"),
    "other activation": (set_at(*FIELD, "activation", value="gelu"), "'gelu'.*relu"),
    "other kind": (set_at(*FIELD, "kind", value="normal"), "'normal'.*displacement"),
    "other domain": (set_at(*FIELD, "domain", value="time"), "'time'.*base"),
    "displacement over space": (set_at(*FIELD, "domain", value="space"), "over space"),
    "other encoding": (set_at(*FIELD, "encoding", "kind", value="hash"), "'hash'.*periodic"),
    "wide features": (set_at(*FIELD, "features", value=[200, 0.1]), "do not end"),
    "too wide features": (set_at(*FIELD, "features", value=[257, 0.1]), "not an integer from 0 to 256"),
    "half a feature pair": (set_at(*FIELD, "features", value=[4]), "list of 2 to 2"),
    "wide layer": (set_at(*FIELD, "layers", 0, 0, value=4097), "not an integer from 1 to 4096"),
    "two outputs": (set_at(*FIELD, "layers", 2, 0, value=2), "outputs, 3 are needed|do not end"),
    "many layers": (set_at(*FIELD, "layers", value=[[3, 0.1, 0.1]] * 33), "list of 1 to 32"),
    "no layers": (set_at(*FIELD, "layers", value=[]), "list of 1 to 32"),
    "zero step": (set_at(*FIELD, "features", 1, value=0), "number from 1e-30"),
    "negative step": (set_at(*FIELD, "features", 1, value=-0.1), "number from 1e-30"),
    "huge step": (set_at(*FIELD, "features", 1, value=1e39), "to 1e\\+30"),
    "other store": (set_at(*FIELD, "features", 1, value="float64"), "'float64'.*float32"),
    "endless levels": (set_at(*FIELD, "encoding", "levels", value=25), "integer from 0 to 24"),
    "endless frequency": (set_at(*FIELD, "encoding", "base_frequency", value=1.6e7), "too high a frequency"),
    "yes for true": (set_at(*FIELD, "residual", value="yes"), "not true or false"),
    "zero scale": (set_at("scale", value=0.0), "scale"),
    "two-dimensional center": (set_at("center", value=[0.0, 1.0]), "list of 3"),
    "text in center": (set_at("center", value=["0", 0, 0]), r"center\[0\] is not a number"),
    "no displacement": (delete(*FIELD), "add up|do not end|no displacement"),
    "no fields": (delete("fields"), "lacks 'fields'"),
    "fields as a list": (set_at("fields", value=[]), "not an object"),
    "odd name": (set_at("fields", "../../etc", value={}), "names a field"),
    "unknown entry": (set_at("base_mesh", "texture", value=1), "unknown entry 'texture'"),
    "provenance as text": (set_at("provenance", value="me"), "not an object"),
}


@pytest.mark.parametrize("lie", LIES)
def test_lying_header(lie: str) -> None:
    change, message = LIES[lie]
    with pytest.raises(AssetError, match=message):
        parse_asset(repack(asset_bytes(small_content()), change))


def test_infinite_numbers_in_the_header() -> None:
    data = asset_bytes(small_content())
    for value in (float("nan"), float("inf"), 10**400):
        with pytest.raises(AssetError):
            parse_asset(repack(data, set_at("scale", value=value)))


def test_infinite_plain_numbers() -> None:
    content = small_content(quantised=False)
    block = content.fields["displacement"]
    broken = dataclasses.replace(block, biases=(np.full(16, np.inf, np.float32), *block.biases[1:]))
    with pytest.raises(AssetError, match=r"'displacement', layer 0, .*finite"):
        asset_bytes(dataclasses.replace(content, fields={"displacement": broken}))


def test_bomb_in_the_header() -> None:
    bomb = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = bomb.compress(b'{"a":"' + b"x" * (64 << 20) + b'"}') + bomb.flush()
    body = asset_bytes(small_content())[:6] + struct.pack("<HI", 1, len(packed)) + packed
    with pytest.raises(AssetError, match="wrong length"):
        parse_asset(body + hashlib.sha256(body).digest()[:16])


def test_nested_header() -> None:
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = deflate.compress(b"[" * 500_000) + deflate.flush()
    body = asset_bytes(small_content())[:6] + struct.pack("<HI", 1, len(packed)) + packed
    with pytest.raises(AssetError, match="cannot be read"):
        parse_asset(body + hashlib.sha256(body).digest()[:16])


def test_bytes_between_the_parts() -> None:
    with pytest.raises(AssetError, match="add up"):
        parse_asset(repack(asset_bytes(small_content()), insert=b"\0"))


def test_not_an_asset(tmp_path: Path) -> None:
    for content in (b"", b"ply\nformat", b"PK\3\4" + b"\0" * 100):
        (tmp_path / "b.ndf").write_bytes(content)
        with pytest.raises(AssetError, match=re.escape(str(tmp_path / "b.ndf")) + ".* not an .ndf asset"):
            read_asset(tmp_path / "b.ndf")


def test_no_such_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read .*none.ndf: No such file"):
        read_asset(tmp_path / "none.ndf")
    with pytest.raises(InputError, match="directory"):
        read_asset(tmp_path)
    with pytest.raises(OutputError, match="folder"):
        write_asset(small_content(), tmp_path)
    assert list(tmp_path.iterdir()) == []


INCONSISTENT: dict[str, tuple[Callable[[AssetContent], dict[str, Any]], str]] = {
    "other vertices": (lambda c: {"vertices": c.vertices + 0.5}, "not what its Draco blob"),
    "infinite center": (lambda c: {"center": np.array([np.inf, 0, 0])}, "center"),
    "negative scale": (lambda c: {"scale": -1.0}, "scale"),
    "face index": (lambda c: {"faces": c.faces + 1}, "does not exist"),
    "misnamed field": (lambda c: {"fields": {**c.fields, "other": c.fields["displacement"]}}, "calls itself"),
    "only the inverse": (lambda c: {"fields": {"inverse": c.fields["inverse"]}}, "no displacement"),
    "provenance": (lambda c: {"provenance": {"path": Path()}}, "as JSON"),
    "provenance not a number": (lambda c: {"provenance": {"rms": float("nan")}}, "as JSON"),
}


@pytest.mark.parametrize("case", INCONSISTENT)
def test_inconsistent_content_is_never_written(case: str, tmp_path: Path) -> None:
    change, message = INCONSISTENT[case]
    content = small_content()
    with pytest.raises(AssetError, match=message):
        write_asset(dataclasses.replace(content, **change(content)), tmp_path / "a.ndf")
    assert not (tmp_path / "a.ndf").exists()
