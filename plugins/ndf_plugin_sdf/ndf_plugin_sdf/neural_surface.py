"""Opening `neural`: weights and a description, or a function, become a field, and the field a surface."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_core.surfaces.level_set_surface import level_set_surface
from ndf_plugin_sdf.defaults import TRAINING_DEFAULTS
from ndf_plugin_sdf.level_box import Coarse
from ndf_plugin_sdf.network_field import Frame, NetworkField
from ndf_plugin_sdf.networks.assemble import assemble
from ndf_plugin_sdf.networks.chain import find_chain
from ndf_plugin_sdf.networks.describe import described
from ndf_plugin_sdf.networks.description import NetworkDescription
from ndf_plugin_sdf.networks.mlp import Mlp
from ndf_plugin_sdf.networks.read import read_arrays
from ndf_plugin_sdf.networks.sidecar import with_description
from ndf_plugin_sdf.neural import NeuralConfig
from ndf_plugin_sdf.slope import estimated_lipschitz, uniform_points

_DEFAULT_BOUNDS = Box(np.full(3, -1.0), np.full(3, 1.0))
_SAMPLES = 8192
_STEEP = 8.0
"""A field with a larger Lipschitz bound is no distance but an occupancy, with plateaus."""


def open_neural(source: str | Path | object, config: NeuralConfig) -> Surface:
    """Open a file of weights.

    Raises:
        InputError: it cannot be read, is not a network of a point, or has no level set within the bounds.
    """
    if not isinstance(source, (str, Path)):
        raise InputError(f"neural: need a file of weights, not {type(source).__name__}")
    path = Path(source)
    config, notes = with_description(path, config)
    arrays = read_arrays(path)
    try:
        chain = find_chain(arrays, config.network.prefix)
        description, found = described(chain, config.network)
        network = assemble(chain, description)
        field, more = _field(network, description, config)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return level_set_surface(
        "neural",
        field,
        resolution=config.resolution,
        corrections=config.corrections,
        fingerprint=fingerprint(
            "neural", config, [part for layer in chain.layers for part in (layer.weight, layer.bias)]
        ),
        training_defaults=TRAINING_DEFAULTS,
        notes=(*notes, *found, *more),
    )


def _field(network: Mlp, description: NetworkDescription, config: NeuralConfig) -> tuple[NetworkField, list[str]]:
    """The field with its side, its box and its steepness found."""
    bounds = _DEFAULT_BOUNDS if config.bounds is None else Box(*np.array(config.bounds))
    frame = Frame(description.input_offset, description.input_scale, _level(description, config.iso))
    coarse = Coarse.of(NetworkField(network, frame, bounds))
    border = coarse.negative_border
    notes: list[str] = []
    if config.inside == "above" or (config.inside == "auto" and border > 0.5):
        frame, coarse = replace(frame, sign=-1.0), replace(coarse, values=-coarse.values)
        if config.inside == "auto":
            notes.append(f"{border:.0%} of the box's border is below the iso value: inside is taken to be above it")
    if not (coarse.values < 0).any():
        raise InputError(_empty(coarse, bounds))
    field = NetworkField(network, frame, coarse.box_of_inside())
    points = uniform_points(field, _SAMPLES)
    field.lipschitz = estimated_lipschitz(field, points) or np.inf
    field.has_plateaus = field.lipschitz > _STEEP
    kind = ": it is read like an occupancy, by its sign" if field.has_plateaus else ""
    notes.append(f"|phi| is estimated to be at most {field.lipschitz:.3g} times the distance{kind}")
    return field, notes


def _level(description: NetworkDescription, iso: float | None) -> float:
    """The value before the last function at the surface: it is monotone, so the level set is the same without it.

    Raises:
        InputError: the function does not reach the iso value.
    """
    match description.output:
        case "none":
            return iso or 0.0
        case "tanh":
            low, level, value = -1.0, float(np.arctanh(np.clip(iso or 0.0, -1, 1))), iso or 0.0
        case "sigmoid":
            low, value = 0.0, 0.5 if iso is None else iso
            level = float(np.log(value) - np.log1p(-value)) if 0 < value < 1 else 0.0
    if not low < value < 1.0:
        raise InputError(
            f"the iso value {value:g} is not between {low:g} and 1, all that a {description.output} gives"
        )
    return level


def _empty(coarse: Coarse, bounds: Box) -> str:
    low, high = (", ".join(f"{x:g}" for x in corner) for corner in (bounds.lower, bounds.upper))
    return (
        f"the network has no zero level set between ({low}) and ({high}): relative to the iso value it runs from "
        f"{coarse.values.min():.4g} to {coarse.values.max():.4g} on a grid of 64. Check --bounds, --iso, --inside; "
        "if the network was trained on nothing, there is no surface in it"
    )
