"""What the representations of this plugin have in common, without heavy imports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

API_VERSION = 1
"""Version of `ndf_core.api` that this plugin was made for."""

WINDING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Table 3, oriented point clouds; the same weights are ours for soups. A traced projection costs some ten times a
training step per sample."""

POINTS_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e5, "projection": 1e4}, "projection_visits": 4}
"""Table 3, non-oriented point clouds."""

POINT_SUFFIXES = (".ply", ".xyz", ".pts", ".pcd", ".pwn")
