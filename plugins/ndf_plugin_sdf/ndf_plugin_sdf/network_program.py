"""Networks that come as code: a function or module, one that is named, or an exported program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_plugin_sdf.callable_field import CallableField
from ndf_plugin_sdf.user_function import UserFunction, probe


def load_program(path: Path, trusted: bool) -> Callable[[Any], Any]:
    """The function in an exported program.

    `torch.export.load` evaluates expressions in the file and unpickles where its safe loader fails, so a file can run
    any code: it has to be trusted.

    Raises:
        InputError: it is not trusted, or cannot be loaded.
    """
    if not trusted:
        raise InputError(
            f"{path}: an exported program can run any code when it is loaded. If you trust where it comes from, say "
            "--trust-program; safer is to save the network's state_dict() as .safetensors"
        )
    try:
        return torch.export.load(path).module()
    except Exception as error:  # torch raises all kinds for broken files
        raise InputError(f"{path}: the program cannot be loaded: {' '.join(str(error).split())[:200]}") from error


def as_network(name: str, function: Callable[[Any], Any], bounds: Box) -> UserFunction:
    """The function as one of double-precision points; networks in single precision get them in single precision.

    Raises:
        InputError: it takes neither.
    """
    points = torch.from_numpy(bounds.corners[:7])
    try:
        return probe(name, function, points)
    except InputError:
        return probe(name, _Single(function), points)


class _Single:
    """Calls a network of single precision."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def __call__(self, points: Any) -> Any:
        return self._function(points.to(torch.float32) if isinstance(points, torch.Tensor) else points)


def program_field(function: UserFunction, iso: float, sign: float, bounds: Box) -> CallableField:
    """sign * (function - iso); the slope is estimated later."""

    def levelled(points: Any) -> Any:
        return sign * (function.function(points) - iso)

    field = CallableField(replace(function, function=levelled), bounds, 1.0)
    field.rounding = 1e-7 if function.single_precision else field.rounding
    return field
