"""The colours of an input as a learned field of its asset (Sec. 3.5)."""

from __future__ import annotations

import numpy as np

from ndf_core.asset.asset import Asset
from ndf_core.asset.fields import COLOR
from ndf_core.config.field import FieldConfig
from ndf_core.errors import ConfigError
from ndf_core.fitting.field_fit import FieldFit, fit_field
from ndf_core.fitting.field_values import FieldValues
from ndf_core.interfaces import ColoredPoints, Surface

_NUMBERS = 40_000
"""Features of all vertices together: some three bits each."""
_MOST_FEATURES = 16
_HIDDEN = 48
_STEPS = 3600
_SIZE = 14_850
"""Most bytes of all numbers: the asset grows by 15,000 at most."""
_ROUNDING = 0.05
"""Where that takes fewer bytes."""


def colors_of(surface: Surface) -> ColoredPoints:
    """The input's colours.

    Raises:
        ConfigError: it has none.
        InputError: they cannot be read.
    """
    found = surface.colors() if surface.colors else None
    if found is None or not len(found.points):
        raise ConfigError("--colors: this input has no colours that can be read; leave the option out")
    return found


def learn_colors(asset: Asset, colored: ColoredPoints, seed: int = 0, threads: int = 1) -> FieldFit:
    """Add the field `color`: red, green and blue in [0, 1].

    Colours of splats and scans scatter, so the median of what lies at a spot is learned rather than the mean.
    """
    features = int(np.clip(_NUMBERS // len(asset.content.vertices), 1, _MOST_FEATURES))
    config = FieldConfig(
        kind="continuous",
        loss="absolute",
        feature_dim=features,
        feature_scale=0.3,
        feature_learning_rate=0.2,
        rounding=_ROUNDING,
        size=_SIZE,
        hidden=_HIDDEN,
        steps=_STEPS,
        seed=seed,
    )
    values = FieldValues(colored.points, colored.colors)
    return fit_field(asset, values, COLOR, config, ("red", "green", "blue"), threads)
