"""Identity of an input: content and options, no path and no time."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable

import numpy as np
from numpy import ndarray as Array
from pydantic import BaseModel


def fingerprint(representation: str, config: BaseModel, content: Iterable[bytes | str | Array]) -> str:
    """SHA-256 in hex over the representation's name, its options as canonical JSON, and the content in order.

    Arrays count with shape and type, in little-endian order, so that machines agree.
    """
    digest = hashlib.sha256()
    options = json.dumps(config.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
    for part in (representation, options, *content):
        if isinstance(part, str):
            data = part.encode()
        elif isinstance(part, bytes):
            data = part
        else:
            array = np.ascontiguousarray(part)
            array = array.astype(array.dtype.newbyteorder("<"))
            data = f"{array.dtype.str}{array.shape}".encode() + array.tobytes()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()
