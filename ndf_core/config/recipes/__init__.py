"""Training recipes: config files in this folder with a [fit] table, which lies over the plugin's training defaults.

A recipe never sets the weights of ``loss``, which belong to the representation (Table 3).
"""

from __future__ import annotations

from importlib.resources import files

from ndf_core.config.layers import Layer
from ndf_core.config.toml import read_config_file


def recipe_names() -> tuple[str, ...]:
    """Names of all recipes, sorted."""
    return tuple(sorted(entry.name[:-5] for entry in files(__name__).iterdir() if entry.name.endswith(".toml")))


def recipe_layer(name: object) -> Layer | None:
    """The layer of a recipe; None where there is none of this name, which validation then reports."""
    if name not in recipe_names():
        return None
    return Layer(f"recipe {name}", read_config_file(str(files(__name__) / f"{name}.toml")).fit)
