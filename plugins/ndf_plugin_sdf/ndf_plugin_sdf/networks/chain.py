"""Named arrays to the layers of one network: weights with biases, their order, orientation and activation."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, get_args

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import InputError
from ndf_plugin_sdf.networks.description import ActivationName
from ndf_plugin_sdf.networks.likeness import is_distance

NamedArrays = Mapping[str, Array]

_PARAMETER = re.compile(
    r"(?P<layer>.*?)[./_]?"
    r"(?P<kind>weight_[gv]|parametrizations\.weight\.original[01]|weights?|kernel|bias(?:es)?|vars/[01]|[AWwBb](?=\d*$))"
    r"(?P<number>:0|\d*)$"
)
_MATRIX, _VECTOR = ("weight", "weights", "kernel", "vars/0", "A", "W", "w"), ("bias", "biases", "vars/1", "B", "b")
_GAIN = ("weight_g", "parametrizations.weight.original0")
_DIRECTION = ("weight_v", "parametrizations.weight.original1")


@dataclass(frozen=True)
class RawLayer:
    """One layer; as a file has it, its weights may be (in, out) and its bias may be missing."""

    name: str
    weight: Float[Array, "rows columns"]
    bias: Float[Array, " n"] | None


class DenseLayer(NamedTuple):
    """One layer of a chain."""

    name: str
    weight: Float[Array, "out in"]
    bias: Float[Array, " out"]


@dataclass(frozen=True)
class Chain:
    """The layers of a network from the first to the last."""

    layers: tuple[DenseLayer, ...]
    skips: tuple[int, ...]
    """Layers whose input is the previous output and the network's own input."""
    activation: ActivationName | None
    """Where the names say it."""
    ignored: tuple[str, ...]
    """Names of arrays that are no part of it."""

    @property
    def input_width(self) -> int:
        return self.layers[0].weight.shape[1]


def find_chain(arrays: NamedArrays, prefix: str | None) -> Chain:
    """The one network in `arrays`, or the one whose names begin with `prefix`.

    Raises:
        InputError: there is none, more than one, or what is there is no multilayer perceptron.
    """
    named = {name: array for name, array in arrays.items() if name.startswith(prefix or "")}
    if not named:
        raise InputError(f"no array's name begins with {prefix!r}; there are {_listed(arrays)}")
    pairs = _pairs(named)
    if not pairs:
        raise InputError(f"there are no weights of layers among the arrays {_listed(named)}")
    used = [named_group for named_group in _groups(pairs) if _linked(named_group) is not None]
    if len(used) > 1:
        used = [group for group in used if is_distance(group[0].name)] or used
    if len(used) != 1:
        found = ", ".join(f"{group[0].name!r} ({len(group)} layers)" for group in used) or "none"
        shapes = ", ".join(f"{layer.name} {layer.weight.shape}" for layer in pairs[:12])
        raise InputError(
            f"need one chain of layers that begins with a point, found {found} among {shapes}; "
            "say which with --network.prefix"
        )
    linked = _linked(used[0])
    assert linked is not None  # it was kept for that
    layers, skips = linked
    own = {layer.name for layer in layers}
    ignored = tuple(name for name in arrays if not any(name.startswith(layer) for layer in own) and arrays[name].size)
    return Chain(layers, skips, _activation_in(named), ignored)


def _pairs(arrays: NamedArrays) -> list[RawLayer]:
    """Weight matrices with their biases, in natural order of their names (layer 10 after layer 9)."""
    parts: dict[str, dict[str, Array]] = {}
    for name, array in arrays.items():
        match = _PARAMETER.match(name)
        if match is not None:
            number = match["number"].removeprefix(":0")
            parts.setdefault(match["layer"] + number, {})[match["kind"]] = array
    layers: list[RawLayer] = []
    for name in sorted(parts, key=_natural):
        weight = _weight(parts[name])
        if weight is None:
            continue
        bias = _first(parts[name], _VECTOR)
        if bias is not None and bias.size not in weight.shape:
            raise InputError(f"layer {name!r}: a bias of {bias.size} numbers does not fit weights {weight.shape}")
        layers.append(RawLayer(name, weight, None if bias is None else bias.reshape(-1).astype(np.float64)))
    return layers


def _weight(parts: Mapping[str, Array]) -> Float[Array, "a b"] | None:
    """The matrix; where it is given as length and direction of its rows (weight norm), their product."""
    gain, direction = _first(parts, _GAIN), _first(parts, _DIRECTION)
    if gain is not None and direction is not None and direction.ndim == 2 and gain.size == direction.shape[0]:
        direction = direction.astype(np.float64)
        norm = np.linalg.norm(direction, axis=1, keepdims=True)
        return direction * (gain.reshape(-1, 1).astype(np.float64) / np.maximum(norm, 1e-300))
    matrix = _first(parts, _MATRIX)
    return matrix.astype(np.float64) if matrix is not None and matrix.ndim == 2 and matrix.size else None


def _groups(layers: list[RawLayer]) -> list[list[RawLayer]]:
    """All layers as one chain, or else those whose names differ in their number only."""
    if _linked(layers) is not None:
        return [layers]
    groups: dict[str, list[RawLayer]] = {}
    for layer in layers:
        groups.setdefault(re.sub(r"\d+(?=\D*$)", "#", layer.name), []).append(layer)
    return list(groups.values())


def _linked(layers: list[RawLayer]) -> tuple[tuple[DenseLayer, ...], tuple[int, ...]] | None:
    """The layers as (out, in), and the skips; None where one's output is not the next one's input."""
    for turned in (False, True):
        oriented: list[DenseLayer] = []
        for layer in layers:
            weight = layer.weight.T if turned else layer.weight
            bias = np.zeros(len(weight)) if layer.bias is None else layer.bias
            if len(bias) == len(weight):
                oriented.append(DenseLayer(layer.name, weight, bias))
        if len(oriented) < len(layers):
            continue
        width = oriented[0].weight.shape[1]
        extra = [after.weight.shape[1] - len(before.weight) for before, after in itertools.pairwise(oriented)]
        if width >= 3 and all(more in (0, width) for more in extra):
            return tuple(oriented), tuple(i + 1 for i, more in enumerate(extra) if more)
    return None


def _activation_in(arrays: NamedArrays) -> ActivationName | None:
    """The activation that empty arrays name (``0001.elu._``).

    Raises:
        InputError: they name several, or something that is none.
    """
    kinds = {name.split(".")[-2] for name, array in arrays.items() if array.size == 0 and name.count(".") >= 2}
    known = kinds & set(get_args(ActivationName))
    unknown = kinds - known - {"squeeze_last", "identity"}
    if unknown or len(known) > 1:
        raise InputError(f"layers of the kinds {', '.join(sorted(kinds))}: only one known activation can be read")
    for name in get_args(ActivationName):
        if name in known:
            return name
    return None


def _first(parts: Mapping[str, Array], kinds: Iterable[str]) -> Array | None:
    return next((parts[kind] for kind in kinds if kind in parts), None)


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


def _listed(arrays: Iterable[str]) -> str:
    names = list(arrays)
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
