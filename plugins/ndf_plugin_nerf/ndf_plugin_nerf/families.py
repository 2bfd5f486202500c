"""Names that implementations of NeRF give to the layers before the density; standard library only, for `sniff`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Family:
    """How one implementation names its trunk and its density, and what its forward pass does with them."""

    name: str
    trunk: str
    """Regular expression of the name of a trunk layer; its group, where there is one, is the layer's number."""
    first: str | None
    """Name of the first layer where it is not one of `trunk`; it then has no activation behind it."""
    densities: tuple[tuple[str, int], ...]
    """Layers that give the density, and the row of their output that is it."""
    skip_order: Literal["hidden_first", "input_first"]
    """Order of the two parts of a skip connection's input."""

    def density(self, layers: Iterable[str]) -> tuple[str, int] | None:
        """The density layer among names of layers, and its row; None where the trunk or the density is missing."""
        names = set(layers)
        trunk = [name for name in names if re.fullmatch(self.trunk, name)]
        if not trunk or (self.first is not None and self.first not in names):
            return None
        return next(((name, row) for name, row in self.densities if name in names), None)


FAMILIES = (
    # FlexibleNeRFModel applies no activation after `layer1`.
    Family("FlexibleNeRFModel", r"layers_xyz\.(\d+)", "layer1", (("fc_alpha", 0), ("fc_out", 3)), "hidden_first"),
    Family("nerf-pytorch", r"pts_linears\.(\d+)", None, (("alpha_linear", 0), ("output_linear", 3)), "input_first"),
    Family("nerf_pl", r"xyz_encoding_(\d+)\.0", None, (("sigma", 0),), "input_first"),
)
"""krrish94/nerf-pytorch, yenchenlin/nerf-pytorch, kwea123/nerf_pl: Mildenhall et al. 2020 in PyTorch. All take
xyz and then sin and cos of 2^k xyz, octave by octave, and give a density through a ReLU."""


@dataclass(frozen=True)
class Named:
    """One network among the names of a file's arrays."""

    prefix: str
    """What its arrays' names begin with."""
    family: Family
    density: str
    row: int


def networks(names: Iterable[str]) -> list[Named]:
    """The density networks that the names of arrays show, in order of their prefixes."""
    layers: dict[str, set[str]] = {}
    for name in names:
        layer = name.removesuffix(".weight")
        if layer == name:
            continue
        for family in FAMILIES:
            own = re.search(rf"(?:^|(?<=\.))(?:{family.trunk}|{'|'.join(_fixed(family))})$", layer)
            if own is not None:
                layers.setdefault(layer[: own.start()], set()).add(layer[own.start() :])
    found: list[Named] = []
    for prefix, own in sorted(layers.items()):
        for family in FAMILIES:
            density = family.density(own)
            if density is not None:
                found.append(Named(prefix, family, *density))
    return found


def _fixed(family: Family) -> list[str]:
    return [re.escape(name) for name in (family.first, *(name for name, _ in family.densities)) if name]


def preferred(found: list[Named]) -> list[Named]:
    """Those of the fine networks, where some are; else those that are not called coarse; else all."""
    fine = [one for one in found if "fine" in one.prefix.lower()]
    others = [one for one in found if "coarse" not in one.prefix.lower()]
    return fine or others or found
