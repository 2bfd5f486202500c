"""What the representations of this plugin have in common, without heavy imports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

API_VERSION = 1
"""Version of `ndf_core.api` that this plugin was made for."""

WINDING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Table 3, oriented point clouds. A traced projection costs some ten times a training step per sample."""

CLOSEST_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "loss": {"cycle": 1e2, "projection": 1e4}}
"""Soups that land on their closest triangle: a projection as smooth as a mesh's, and so the weights of one."""

POINTS_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e5, "projection": 1e4}, "projection_visits": 4}
"""Table 3, non-oriented point clouds."""

POINT_SUFFIXES = (".ply", ".xyz", ".pts", ".pcd", ".pwn")
