"""Opening `neural`: weights and a description, or a function, become a field, and the field a surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.surfaces.box import Box
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_core.surfaces.implicit_field import ImplicitField
from ndf_core.surfaces.level_set_surface import level_set_surface
from ndf_plugin_sdf.analytic import names_callable
from ndf_plugin_sdf.capped_field import capped_by_box
from ndf_plugin_sdf.defaults import COSTLY_TRAINING_DEFAULTS
from ndf_plugin_sdf.level_box import Coarse
from ndf_plugin_sdf.network_field import Frame, NetworkField
from ndf_plugin_sdf.network_program import as_network, load_program, program_field
from ndf_plugin_sdf.networks.assemble import assemble
from ndf_plugin_sdf.networks.chain import find_chain
from ndf_plugin_sdf.networks.describe import described
from ndf_plugin_sdf.networks.description import NetworkDescription
from ndf_plugin_sdf.networks.formats import look
from ndf_plugin_sdf.networks.read import read_arrays
from ndf_plugin_sdf.networks.sidecar import with_description
from ndf_plugin_sdf.neural import NeuralConfig
from ndf_plugin_sdf.slope import estimated_slopes, uniform_points
from ndf_plugin_sdf.user_function import find

_DEFAULT_BOUNDS = Box(np.full(3, -1.0), np.full(3, 1.0))
_SAMPLES = 8192
_STEEP = 6.0
"""A field whose Lipschitz bound is so many times its usual slope is no distance but an occupancy, with plateaus."""


def open_neural(source: str | Path | object, config: NeuralConfig) -> Surface:
    """Open a file of weights, an exported program, or a function (named, or the function or module itself).

    A function or a program runs with the rights of the caller: it is code.

    Raises:
        InputError: it cannot be read, is not a network of a point, or has no level set within the bounds.
    """
    if isinstance(source, (str, Path)) and not names_callable(source):
        return _from_file(Path(source), config)
    if isinstance(source, (str, Path)):
        return _from_function(str(source), find(str(source))[0], config)
    if callable(source):
        return _from_function(getattr(source, "__qualname__", type(source).__name__), source, config)
    raise InputError(f"neural: need a file of weights, module:callable or a function, not {type(source).__name__}")


def _from_file(path: Path, config: NeuralConfig) -> Surface:
    config, notes = with_description(path, config)
    try:
        found = look(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    if found is not None and found.format == "program":
        return _from_function(str(path), load_program(path, config.trust_program), config)
    arrays = read_arrays(path)
    try:
        chain = find_chain(arrays, config.network.prefix)
        description, concluded = described(chain, config.network)
        network = assemble(chain, description)
        frame = Frame(description.input_offset, description.input_scale, _level(description, config.iso))
        content = [part for layer in chain.layers for part in (layer.weight, layer.bias)]
        return _surface(
            lambda box, sign: NetworkField(network, replace(frame, sign=sign), box),
            config,
            content,
            [*notes, *concluded],
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _from_function(name: str, function: Callable[[Any], Any], config: NeuralConfig) -> Surface:
    own: Any = getattr(function, "bounds", None)
    if config.bounds is None and own is not None:
        config = NeuralConfig.model_validate({**config.model_dump(exclude_unset=True), "bounds": own})
    network = as_network(name, function, _DEFAULT_BOUNDS)

    def field(box: Box, sign: float) -> ImplicitField:
        return program_field(network, config.iso or 0.0, sign, box)

    points = uniform_points(_bounds(config), _SAMPLES)
    return _surface(field, config, [network(points).detach().numpy()], [])


def _surface(
    field_in: Callable[[Box, float], ImplicitField], config: NeuralConfig, content: list[Any], notes: list[str]
) -> Surface:
    field, more = _placed(field_in, config)
    return level_set_surface(
        "neural",
        field,
        resolution=config.resolution,
        corrections=config.corrections,
        fingerprint=fingerprint("neural", config, content),
        training_defaults=COSTLY_TRAINING_DEFAULTS,
        notes=(*notes, *more),
    )


def _placed(field_in: Callable[[Box, float], ImplicitField], config: NeuralConfig) -> tuple[ImplicitField, list[str]]:
    """The field with its side, its box and its steepness found; `field_in` makes it of a box and a sign."""
    bounds, sign = _bounds(config), 1.0
    coarse = Coarse.of(field_in(bounds, sign))
    border = coarse.negative_border
    notes: list[str] = []
    if config.inside == "above" or (config.inside == "auto" and border > 0.5):
        sign, coarse = -1.0, replace(coarse, values=-coarse.values)
        if config.inside == "auto":
            notes.append(f"{border:.0%} of the box's border is below the iso value: inside is taken to be above it")
    if not (coarse.values < 0).any():
        raise InputError(_empty(coarse))
    field = field_in(coarse.box_of_inside(), sign)
    slopes = estimated_slopes(field, uniform_points(field.bounds, _SAMPLES))
    if slopes is None:
        raise InputError("no point could be projected onto the network's level set; is its gradient zero everywhere?")
    field.lipschitz = slopes.lipschitz
    field.has_plateaus = slopes.lipschitz > _STEEP * slopes.typical
    kind = ": read by its sign, like an occupancy" if field.has_plateaus else ""
    notes.append(f"|phi| is estimated to be at most {slopes.lipschitz:.3g} times the distance{kind}")
    if coarse.negative_border:
        field = capped_by_box(field, bounds, slopes.at_surface)
        notes.append("the level set reaches the bounds and is closed there with a flat cap (--bounds)")
    return field, notes


def _bounds(config: NeuralConfig) -> Box:
    return _DEFAULT_BOUNDS if config.bounds is None else Box(*np.array(config.bounds))


def _level(description: NetworkDescription, iso: float | None) -> float:
    """The value before the last function at the surface: it is monotone, so the level set is the same without it.

    Raises:
        InputError: the function does not reach the iso value.
    """
    if description.output == "none":
        return iso or 0.0
    low, usual = (-1.0, 0.0) if description.output == "tanh" else (0.0, 0.5)
    value = usual if iso is None else iso
    if not low < value < 1.0:
        raise InputError(
            f"the iso value {value:g} is not between {low:g} and 1, all that a {description.output} gives"
        )
    return float(np.arctanh(value) if description.output == "tanh" else np.log(value) - np.log1p(-value))


def _empty(coarse: Coarse) -> str:
    low, high = (", ".join(f"{x:g}" for x in corner) for corner in (coarse.bounds.lower, coarse.bounds.upper))
    return (
        f"the network has no zero level set between ({low}) and ({high}): relative to the iso value it runs from "
        f"{coarse.values.min():.4g} to {coarse.values.max():.4g} on a grid of 64. Check --bounds, --iso, --inside; "
        "if the network was trained on nothing, there is no surface in it"
    )
