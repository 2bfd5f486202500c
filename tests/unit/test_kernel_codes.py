"""The range coder: round trips, equal bytes to the readable version, and how near it comes to the entropy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Int
from numpy import ndarray as Array

from ndf_core.kernels.codes import decode_codes, encode_codes
from ndf_core.kernels.reference import codes as reference

Codes = list[Int[Array, "rows columns"]]


def awkward_arrays() -> dict[str, Codes]:
    rng = np.random.default_rng(3)
    return {
        "bell": [np.rint(rng.normal(size=(120, 16)) * rng.uniform(1, 60, 16))],
        "zeros": [np.zeros((5, 3))],
        "lowest": [np.full((4, 4), -32768)],
        "highest": [np.full((4, 4), 32767)],
        "one code": [np.array([[-1]])],
        "uniform, then signs": [rng.integers(-32768, 32768, size=(40, 7)), rng.integers(-1, 2, size=(9, 1))],
        "heavy tails": [np.clip(np.rint(rng.standard_cauchy(size=(200, 5)) * 3), -32768, 32767)],
        "outlier after zeros": [np.array([[0]] * 60 + [[32767], [-32768]])],
    }


@pytest.mark.parametrize("name", awkward_arrays())
def test_round_trip_and_equal_to_reference(name: str) -> None:
    arrays = [array.astype(np.int16) for array in awkward_arrays()[name]]
    data = encode_codes(arrays)
    assert data == reference.encode_codes(arrays)
    for array, decoded in zip(arrays, decode_codes(data, [a.shape for a in arrays]), strict=True):
        assert decoded.dtype == np.int16
        np.testing.assert_array_equal(decoded, array)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(1, 6), st.integers(1, 6), st.integers(0, 15), st.integers(0, 2**32 - 1)), max_size=4
    )
)
def test_any_arrays_come_back(sizes: list[tuple[int, int, int, int]]) -> None:
    arrays: Codes = []
    for rows, columns, bits, seed in sizes:
        low = -(1 << bits)
        arrays.append(np.random.default_rng(seed).integers(low, -low, size=(rows, columns)).astype(np.int16))
    decoded = decode_codes(encode_codes(arrays), [array.shape for array in arrays])
    assert all(np.array_equal(one, two) for one, two in zip(arrays, decoded, strict=True))


def test_bell_shaped_columns_cost_their_entropy() -> None:
    rng = np.random.default_rng(0)
    scale = np.geomspace(3, 60, 16)
    codes = np.rint(rng.normal(size=(2000, 16)) * scale).astype(np.int16)
    entropy = 2000 * np.log2(scale * np.sqrt(2 * np.pi * np.e)).sum() / 8  # of a discretised normal variable
    assert entropy * 0.995 < len(encode_codes([codes])) < entropy * 1.015


def test_any_bytes_decode_within_bounds() -> None:
    rng = np.random.default_rng(1)
    for size in (0, 1, 7, 400):
        data = rng.integers(0, 256, size=size, dtype=np.uint8).tobytes()
        try:
            (codes,) = decode_codes(data, [(50, 4)])
        except ValueError as error:
            assert "do not end where" in str(error)
        else:
            assert codes.shape == (50, 4)


def test_streams_of_the_wrong_length_are_refused() -> None:
    codes = np.random.default_rng(0).integers(-99, 99, size=(10, 2)).astype(np.int16)
    with pytest.raises(ValueError, match="do not end"):
        decode_codes(encode_codes([codes]), [(20, 2)])
    with pytest.raises(ValueError, match="do not end"):
        decode_codes(encode_codes([codes])[:8], [(10, 2)])
    with pytest.raises(ValueError, match="do not end"):
        decode_codes(encode_codes([codes]) + b"\x01" * 9, [(10, 2)])
    with pytest.raises(ValueError, match="do not end"):
        decode_codes(b"\x01", [])


def test_empty_arrays_and_large_codes_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one row"):
        encode_codes([np.zeros((3, 0), np.int16)])
    with pytest.raises(ValueError, match="range of int16"):
        encode_codes([np.full((1, 1), 40_000)])
