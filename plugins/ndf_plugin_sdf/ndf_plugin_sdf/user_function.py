"""A user's function phi(points): found by name, called with what it takes, its failures told in one line."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.errors import InputError


@dataclass(frozen=True)
class UserFunction:
    """Calls a function on tensors and checks what comes back."""

    name: str
    """For messages: ``module:callable``."""
    function: Callable[[Any], Any]
    takes_tensors: bool
    """Tensors (n, 3); numpy arrays otherwise."""
    differentiable: bool
    """Whether automatic differentiation passes through it."""
    single_precision: bool
    """Whether its answers are float32 or less."""

    def __call__(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """The function's values as float64 on the points' device.

        Raises:
            InputError: it raised, or answered with anything but n real numbers.
        """
        return _called(self.name, self.function, points, self.takes_tensors)[0]


def probe(name: str, function: Callable[[Any], Any], points: Float[Tensor, "n 3"]) -> UserFunction:
    """Find out by calling it what `function` takes: a tensor that wants gradients first, then an array.

    Raises:
        InputError: it takes neither.
    """
    with torch.enable_grad():
        variable = points.detach().clone().requires_grad_(True)
        try:
            values, single = _called(name, function, variable, True)
        except InputError as tensor_failure:
            try:
                _, single = _called(name, function, points, False)
            except InputError as array_failure:
                if str(array_failure) == str(tensor_failure):
                    raise array_failure from None
                raise InputError(f"{array_failure}; and with a tensor: {tensor_failure}") from array_failure
            return UserFunction(name, function, False, False, single)
    return UserFunction(name, function, True, values.requires_grad, single)


def find(source: str) -> tuple[Callable[[Any], Any], ModuleType]:
    """Import what ``module:callable`` or ``file.py:callable`` names, also from the current folder. Runs that code.

    Raises:
        InputError: the module cannot be imported, or has no such callable.
    """
    place, _, name = source.rpartition(":")
    try:
        with _importable(Path(place).parent if place.endswith(".py") else Path()):
            module = _from_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except (Exception, SystemExit) as error:
        raise InputError(f"{source}: importing {place} failed: {_cause(error)}") from error
    found: Any = module
    for part in name.split("."):
        found = getattr(found, part, None)
    if found is None:
        raise InputError(f"{source}: {place} has no {name!r}")
    if not callable(found):
        raise InputError(f"{source}: {name!r} is a {type(found).__name__}, not a function")
    return found, module


@contextmanager
def _importable(folder: Path) -> Generator[None]:
    """The folder first on the import path, for as long as it takes."""
    entry = str(folder.resolve())
    sys.path.insert(0, entry)
    try:
        yield
    finally:
        sys.path.remove(entry)


def _from_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    spec = importlib.util.spec_from_file_location(f"_ndf_user_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # a .py suffix always has a loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickling inside the module look it up
    spec.loader.exec_module(module)
    return module


def _called(
    name: str, function: Callable[[Any], Any], points: Float[Tensor, "n 3"], tensors: bool
) -> tuple[Float[Tensor, " n"], bool]:
    """The values in float64, and whether they came in single precision or less."""
    given: Any = points if tensors else points.detach().cpu().numpy().copy()
    try:
        answer = function(given)
    except Exception as error:
        raise InputError(f"{name} failed: {_cause(error)}") from error
    if not tensors:
        try:
            answer = torch.from_numpy(np.ascontiguousarray(answer))
        except (TypeError, ValueError) as error:
            raise InputError(f"{name} must return an array of numbers, not {type(answer).__name__}") from error
    if not isinstance(answer, Tensor):
        raise InputError(f"{name} must return a tensor for a tensor, not {type(answer).__name__}")
    if not answer.is_floating_point():
        raise InputError(f"{name} must return real numbers, a distance negative inside, not {answer.dtype}")
    count = len(points)
    if answer.shape not in ((count,), (count, 1)):
        raise InputError(f"{name} must return shape ({count},) for points ({count}, 3), not {tuple(answer.shape)}")
    return answer.reshape(count).to(points), torch.finfo(answer.dtype).bits < 64


def _cause(error: BaseException) -> str:
    """Kind, message and place of an error: the innermost frame outside of installed packages, else the innermost."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        f for f in frames if "site-packages" not in f.filename and not f.filename.startswith(("<", _HERE, _STDLIB))
    ]
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    if isinstance(error, SyntaxError) and error.filename:
        return text
    frame = (own or [None])[-1]
    return text if frame is None else f"{text} ({Path(frame.filename).name}, line {frame.lineno})"


_HERE = str(Path(__file__).parent)
_STDLIB = str(Path(traceback.__file__).parent)
