"""The .splat format: rows of 32 bytes without a header."""

from __future__ import annotations

import numpy as np

from ndf_plugin_gaussians.detect import SPLAT_ROW
from ndf_plugin_gaussians.splats import Splats, make_splats

_ROW = np.dtype([("centre", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])


def read_splat(data: bytes) -> tuple[Splats, int]:
    """Splats, and the number of those left out as not finite (or with a negative scale).

    Raises:
        ValueError: the file does not consist of whole rows.
    """
    if len(data) % SPLAT_ROW:
        raise ValueError(
            f"{len(data):,} bytes are no whole number of rows of {SPLAT_ROW}; it is cut off or no .splat"
        )
    rows = np.frombuffer(data, _ROW)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_scales = np.log(rows["scale"].astype(np.float64))
    return make_splats(
        centres=rows["centre"].astype(np.float64),
        log_scales=log_scales,
        quaternions=(rows["rotation"].astype(np.float64) - 128.0) / 128.0,
        opacities=rows["colour"][:, 3] / 255.0,
        colours=rows["colour"][:, :3] / 255.0,
    )
