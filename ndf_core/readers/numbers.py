"""Numbers in text, parsed by numpy in one go, with garbage refused rather than skipped."""

from __future__ import annotations

import warnings

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


def parse_numbers(text: bytes) -> Float[Array, " n"]:
    """All numbers in text that is nothing but numbers and white space; float64, "nan" and "inf" included.

    Raises:
        ValueError: something else is in it.
    """
    if not text.strip():
        return np.zeros(0)
    # A null byte would end numpy's parsing in silence.
    if b"\0" in text:
        raise ValueError("there are bytes that are no text")
    with warnings.catch_warnings():
        # Before 2.4, numpy only warns and stops at what it cannot read.
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text.decode("latin-1"), dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError) as error:
            raise ValueError("there is text where numbers should be") from error


def as_indices(numbers: Float[Array, " n"]) -> Array:
    """Whole numbers as int64.

    Raises:
        ValueError: a number is not whole, or larger than any index.
    """
    if not (np.abs(numbers) < 2.0**53).all() or (numbers != np.floor(numbers)).any():
        raise ValueError("an index or a count is not a whole number")
    return numbers.astype(np.int64)
