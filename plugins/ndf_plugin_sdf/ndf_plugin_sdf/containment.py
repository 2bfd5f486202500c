"""Whether a solid stays within bounds that a user gave: a surface that leaves them would not be closed."""

from __future__ import annotations

import itertools

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.implicit_field import ImplicitField

_ACROSS = 97


def check_contained(field: ImplicitField, name: str) -> None:
    """Look at a grid on the faces of the bounds: the field must be positive there.

    Raises:
        InputError: the solid reaches the bounds, or the field seems to be negative outside.
    """
    points = _on_faces(field.bounds)
    values = field.values(torch.from_numpy(points)).numpy()
    inside = values <= 0
    if not inside.any():
        return
    if inside.all():
        raise InputError(
            f"{name} is negative all over the faces of the bounds: it must be negative inside and positive outside; "
            "change its sign, or enlarge the bounds"
        )
    place = ", ".join(f"{x:.6g}" for x in points[values.argmin()])
    raise InputError(
        f"{name} reaches the bounds, at ({place}) and {int(inside.sum()) - 1} other places of {len(points)}; "
        "enlarge the bounds, or intersect the solid with a box inside them"
    )


def _on_faces(box: Box) -> Float[Array, "n 3"]:
    steps = np.linspace(0.0, 1.0, _ACROSS)
    u, v = (axis.ravel() for axis in np.meshgrid(steps, steps))
    faces: list[Array] = []
    for axis, end in itertools.product(range(3), (0.0, 1.0)):
        faces.append(np.insert(np.stack([u, v], axis=1), axis, end, axis=1))
    return box.lower + np.concatenate(faces) * (box.upper - box.lower)
