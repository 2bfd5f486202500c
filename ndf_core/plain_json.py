"""Results as JSON that every reader takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def as_json(data: Any) -> str:
    """One line of JSON; numbers that JSON lacks (nan, infinity) become null."""
    import json  # `ndf --help` needs none

    return json.dumps(plain(data), allow_nan=False)


def plain(value: Any) -> Any:
    """JSON's own types; numpy scalars and arrays give theirs through `tolist`."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return plain(value.tolist()) if hasattr(value, "tolist") else str(value)
