"""What the representations of this plugin have in common, without heavy imports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

API_VERSION = 1
"""Version of `ndf_core.api` that this plugin was made for."""

TRAINING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e2, "projection": 1e4}}
"""Table 3: meshes treated as SDFs; ours for analytic fields."""
