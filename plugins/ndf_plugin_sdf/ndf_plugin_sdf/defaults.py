"""What the representations of this plugin have in common, without heavy imports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

API_VERSION = 1
"""Version of `ndf_core.api` that this plugin was made for."""

TRAINING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e2, "projection": 1e4}}
"""Table 3: meshes treated as SDFs; the same weights are ours for analytic fields."""

COSTLY_TRAINING_DEFAULTS: Mapping[str, Any] = {**TRAINING_DEFAULTS, "projection_visits": 4}
"""A projection onto a CSG tree or a network costs some ten times a training step per point, and a good part of
that per call."""

VOLUME_TRAINING_DEFAULTS: Mapping[str, Any] = {**TRAINING_DEFAULTS, "projection_visits": 2, "steps": 1800}
"""As dear; but thin vessels bend within a few visits, and take longer to learn."""
