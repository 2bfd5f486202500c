"""A user's function of points as a density."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.errors import InputError
from ndf_core.surfaces.box import Box
from ndf_plugin_nerf.density import Density


class FunctionDensity(Density):
    """sigma(points): numpy arrays (n, 3), float64, to (n,) densities."""

    def __init__(self, name: str, function: Callable[[Any], Any], bounds: Box | None) -> None:
        """Call it once.

        Args:
            name: for messages.
            function: runs with the rights of the caller: it is code.
            bounds: where it means something; None: its attribute `bounds`.

        Raises:
            InputError: there are no bounds, or it fails.
        """
        self._name, self._function = name, function
        self.bounds = bounds or self._own_bounds()
        middle = (self.bounds.lower + self.bounds.upper) / 2
        self.evaluate(torch.from_numpy(np.stack([self.bounds.lower, middle, self.bounds.upper])))

    def evaluate(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        try:
            answer = np.asarray(self._function(points.cpu().numpy().copy()))
        except Exception as error:
            text = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise InputError(f"{self._name} failed: {text}") from error
        if answer.dtype.kind not in "fiu" or answer.shape not in ((len(points),), (len(points), 1)):
            raise InputError(
                f"{self._name} must return {len(points)} densities for points {tuple(points.shape)}, not "
                f"{answer.dtype} {answer.shape}"
            )
        return torch.from_numpy(answer.reshape(-1).astype(np.float32))

    def _own_bounds(self) -> Box:
        own: Any = getattr(self._function, "bounds", None)
        if own is None:
            raise InputError(f"{self._name}: give the box to look in, --bounds '[[-1, -1, -1], [1, 1, 1]]'")
        try:
            box = np.array(own, dtype=np.float64)
        except (TypeError, ValueError):
            box = np.zeros(0)
        if box.shape != (2, 3) or not np.isfinite(box).all() or not (box[0] < box[1]).all():
            raise InputError(
                f"{self._name}: its attribute `bounds` is no box [[x, y, z], [x, y, z]], low corner first"
            )
        return Box(box[0], box[1])


def find(source: str) -> Callable[[Any], Any]:
    """Import what ``module:callable`` or ``file.py:callable`` names, also from the current folder. Runs that code.

    Raises:
        InputError: the module cannot be imported, or has no such callable.
    """
    place, _, name = source.rpartition(":")
    folder = str((Path(place).parent if place.endswith(".py") else Path()).resolve())
    sys.path.insert(0, folder)
    try:
        found: Any = _from_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except (Exception, SystemExit) as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(f"{source}: importing {place} failed: {text}") from error
    finally:
        sys.path.remove(folder)
    for part in name.split("."):
        found = getattr(found, part, None)
    if not callable(found):
        raise InputError(f"{source}: {place} has no function {name!r}")
    return found


def _from_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    spec = importlib.util.spec_from_file_location(f"_ndf_user_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # a .py suffix always has a loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
