"""Whether arrays of these shapes can be the layers of a signed distance network; standard library only."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

_DISTANCE = ("sdf", "implicit", "glin")
"""NeuS's network, that of IDR and VolSDF, the layers of SDFStudio and nerfstudio."""
_RADIANCE = ("rgb", "color", "colour", "views", "layers_dir", "dir_encod", "sh_net", "direction")


def is_point_network(shapes: Mapping[str, tuple[int, ...]]) -> bool:
    """Whether some matrix takes a point, encoded or not, and no name speaks of colours."""
    if is_radiance(shapes):
        return False
    matrices = [shape for shape in shapes.values() if len(shape) == 2 and min(shape) >= 1]
    # Widths of a point and its encodings: 3, 3 + 6 f, 6 f.
    return len(matrices) >= 2 and any(
        side % 6 in (0, 3) and side < 64 and math.prod(shape) > side for shape in matrices for side in shape
    )


def is_radiance(names: Iterable[str]) -> bool:
    """Whether names speak of colours or directions: it is a NeRF then, unless it also has an SDF (NeuS)."""
    lower = [name.lower() for name in names]
    return any(word in name for word in _RADIANCE for name in lower) and not any(map(is_distance, lower))


def is_distance(name: str) -> bool:
    """Whether an array's name says that it belongs to a signed distance network."""
    return any(word in name.lower() for word in _DISTANCE)
