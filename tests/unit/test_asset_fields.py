"""Field blocks with latent codes and labels: one network per code, kept by the file, refused when wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_assets import small_content

from ndf_core.asset import limits
from ndf_core.asset.asset import Asset
from ndf_core.asset.content import AssetContent, FieldBlock, QuantisedArray, values_of
from ndf_core.asset.file import asset_bytes, parse_asset
from ndf_core.errors import AssetError

CONTENT = small_content()
FACES = np.arange(20, dtype=np.int32)
WEIGHTS = np.random.default_rng(1).dirichlet((1, 1, 1), 20)


def latent_block(count: int = 3, length: int = 2, outputs: int = 2) -> FieldBlock:
    """The displacement's network with latent codes beside its features."""
    rng, block = np.random.default_rng(0), CONTENT.fields["displacement"]
    first = values_of(block.weights[0])
    first = np.concatenate([first, rng.normal(size=(len(first), length)).astype(np.float32)], axis=1)
    codes = QuantisedArray(rng.integers(-99, 99, (count, length)).astype(np.int16), 0.01)
    last = rng.normal(size=(outputs, values_of(block.weights[-1]).shape[1])).astype(np.float32)
    return replace(
        block,
        name="modes",
        kind="continuous",
        residual=False,
        weights=(first, *block.weights[1:-1], last),
        biases=(*block.biases[:-1], np.zeros(outputs, np.float32)),
        latent=codes,
        labels=tuple(f"column {i}" for i in range(count * outputs)),
    )


def with_block(block: FieldBlock) -> AssetContent:
    return replace(CONTENT, fields={**CONTENT.fields, block.name: block})


def test_each_code_is_a_network_of_its_own() -> None:
    block = latent_block()
    found = Asset(with_block(block)).evaluate(FACES, WEIGHTS, "modes")
    assert found.shape == (20, 6)
    assert block.latent is not None
    weights, codes = values_of(block.weights[0]), values_of(block.latent)
    for i, code in enumerate(codes):
        folded = replace(
            block,
            weights=(np.ascontiguousarray(weights[:, :-2]), *block.weights[1:]),
            biases=(values_of(block.biases[0]) + weights[:, -2:] @ code, *block.biases[1:]),
            latent=None,
            labels=(),
        )
        alone = Asset(with_block(folded)).evaluate(FACES, WEIGHTS, "modes")
        assert np.abs(found[:, 2 * i : 2 * i + 2] - alone).max() < 1e-5


@pytest.mark.parametrize("plain", [False, True])
def test_the_file_keeps_them(plain: bool) -> None:
    block = latent_block()
    if plain:
        assert block.latent is not None
        block = replace(block, latent=values_of(block.latent))
    content = with_block(block)
    again = parse_asset(asset_bytes(content))
    kept = again.fields["modes"]
    assert kept.labels == block.labels
    assert kept.latent is not None and block.latent is not None
    assert np.array_equal(values_of(kept.latent), values_of(block.latent))
    evaluate = [Asset(one).evaluate(FACES, WEIGHTS, "modes") for one in (content, again)]
    assert np.array_equal(*evaluate)
    assert asset_bytes(again) == asset_bytes(content)


def test_an_asset_without_them_is_written_as_before() -> None:
    assert b"latent" not in asset_bytes(CONTENT)
    info = Asset(with_block(latent_block())).info()["fields"]["modes"]
    assert (info["latent_codes"], info["columns"]) == ([3, 2], 6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"labels": ("one",)}, "1 labels for 6 columns"),
        ({"latent": np.zeros((0, 2), np.float32)}, "latent codes of shape"),
        ({"latent": np.zeros(3, np.float32)}, "latent codes of shape"),
        ({"latent": np.zeros((3, 3), np.float32)}, "has weights"),
        ({"latent": np.full((3, 2), np.nan, np.float32)}, "not all finite"),
        ({"latent": np.zeros((4000, 2), np.float32), "labels": ()}, "8000 columns"),
        ({"kind": "displacement"}, "cannot have latent codes"),
        ({"residual": True}, "cannot have latent codes"),
        ({"labels": tuple("abcde\n")}, "printable text"),
        ({"labels": (*"abcde", "f" * (limits.LABEL + 1))}, "printable text"),
    ],
)
def test_what_contradicts_itself_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(AssetError, match=message):
        parse_asset(asset_bytes(with_block(replace(latent_block(), **changes))))
