"""What the weights' names and shapes say about a network, where the user says nothing."""

from __future__ import annotations

from ndf_plugin_sdf.networks.chain import Chain
from ndf_plugin_sdf.networks.description import FIELD_PRESETS, NetworkDescription, Preset

_ENCODED = 39
"""Width of a point with six octaves."""


def described(chain: Chain, given: NetworkDescription) -> tuple[NetworkDescription, list[str]]:
    """The whole description, and one line for each thing that was concluded."""
    notes: list[str] = []
    if given.preset is None:
        found = _preset(chain)
        if found is not None and given.activation is None:
            given = given.model_copy(update={"preset": found})
            notes.append(f"its layers are called as in {found}: read with that preset")
    description = given.completed()
    if description.activation is None:
        description = description.model_copy(update={"activation": chain.activation or "relu"})
        if chain.activation is None:
            notes.append("the activation is taken to be relu; --network.activation says otherwise")
    widths = sorted({len(layer.bias) for layer in chain.layers[:-1]}) or [0]
    width = f"{widths[0]}" if len(widths) == 1 else f"{widths[0]} to {widths[-1]}"
    hidden, skips = len(chain.layers) - 1, ", ".join(map(str, chain.skips))
    notes.insert(0, f"{hidden} x {width} {description.activation}{f', skips at {skips}' if skips else ''}")
    if description.preset in FIELD_PRESETS and chain.input_width > _ENCODED:
        notes.append("the features of its grid are taken to be zeros, as they are without use_grid_feature")
    if chain.ignored:
        rest = f" and {len(chain.ignored) - 3} more" if len(chain.ignored) > 3 else ""
        notes.append(f"not a part of the network: {', '.join(chain.ignored[:3])}{rest}")
    return description, notes


def _preset(chain: Chain) -> Preset | None:
    """NeuS calls its layers lin0, lin1, ..., SDFStudio and nerfstudio glin0, ..., and all join their input again at
    the fourth. Of the last two only SDFStudio's field has a Laplace density.

    DeepSDF's are called lin0 as well, but it has neither an encoding nor a second output.
    """
    name = chain.layers[0].name.rsplit(".", 1)[-1]
    outputs = len(chain.layers[-1].bias)
    if chain.skips != (4,) or outputs == 1:
        return None
    if name == "glin0":
        return "sdfstudio" if any("laplace_density" in other for other in chain.ignored) else "nerfstudio"
    return "neus" if name == "lin0" and chain.input_width > 3 else None
