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

POINTS_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Points without normals. Table 3 has 1e5 for closest points of the cloud, which keeps the map at its base mesh;
planes are smoother than points, and allow a tenth of it."""

SHELL_DEFAULTS: Mapping[str, Any] = {**POINTS_DEFAULTS, "loss": {"cycle": 1e3, "projection": 1e4}}
"""Shells around sheets: two sides share the faces, and 1e4 would leave their base mesh to be seen."""

POINT_SUFFIXES = (".ply", ".xyz", ".pts", ".pcd", ".pwn")
