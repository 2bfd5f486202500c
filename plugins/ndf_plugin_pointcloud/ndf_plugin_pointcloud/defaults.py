"""What the representations of this plugin have in common, without heavy imports."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

API_VERSION = 1
"""Version of `ndf_core.api` that this plugin was made for."""

WINDING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Table 3, oriented point clouds. A traced projection costs some ten times a training step per sample."""

CLOSEST_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "loss": {"cycle": 1e2, "projection": 1e4}}
"""Soups that land on their closest triangle: a projection as smooth as a mesh's, and so the weights of one."""

HIDDEN_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "projection_visits": 8}
"""Soups whose parts hide in each other: rays are traced, jump from one part to the next, and are slow."""

DILATED_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "loss": {"cycle": 1e3, "projection": 1e4}}
"""Soups dilated to shells: as smooth, but two sides share the faces; 1e4 leaves the base mesh's facets to be seen."""

POINTS_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Points without normals, before they are opened. Table 3 has 1e5 for closest points of the cloud, which keeps the
map at its base mesh; planes are smoother than points."""

POINTS_CYCLE = ((0.012, 1e3), (0.03, 1e4), (math.inf, 1e5))
"""Opened, their cycle weight is the first here that has their spacing, in sizes, below its bound. Planes of dense
points turn little from one to the next, and the map may follow them; sparse ones say less than the base mesh does.
A shell, whose planes end where its points do, never needs more than the 1e4 above."""

POINT_SUFFIXES = (".ply", ".xyz", ".pts", ".pcd", ".pwn")
