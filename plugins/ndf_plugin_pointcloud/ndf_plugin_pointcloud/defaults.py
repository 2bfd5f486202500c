"""What the representations of this plugin have in common, without heavy imports."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

API_VERSION = 1
"""Version of `ndf_core.api` that this plugin was made for."""

WINDING_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Table 3, oriented point clouds. A traced projection costs some ten times a training step per sample."""

CLEAN_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "loss": {"cycle": 1e3, "projection": 1e4}}
"""Points with normals that have no noise: what is traced turns little from one point to the next, and the map may
follow it. With noise the map must not."""

CLOSEST_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "loss": {"cycle": 1e2, "projection": 1e4}}
"""Soups that land on their closest triangle: a projection as smooth as a mesh's, and so the weights of one."""

HIDDEN_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "projection_visits": 8}
"""Soups whose parts hide in each other: rays are traced, jump from one part to the next, and are slow."""

DILATED_DEFAULTS: Mapping[str, Any] = {**WINDING_DEFAULTS, "loss": {"cycle": 1e3, "projection": 1e4}}
"""Soups dilated to shells: as smooth, but two sides share the faces; 1e4 leaves the base mesh's facets to be seen."""

POINTS_DEFAULTS: Mapping[str, Any] = {"loss": {"cycle": 1e4, "projection": 1e4}, "projection_visits": 4}
"""Points without normals, before they are opened. Table 3 has 1e5 for closest points of the cloud, which keeps the
map at its base mesh; planes are smoother than points."""

SOLID_CYCLE = ((0.03, 1e3), (0.06, 1e4), (math.inf, 1e5))
SHELL_CYCLE = ((0.012, 1e3), (math.inf, 1e4))
"""Opened, the cycle weight of points is the first here that has a length of theirs, in sizes, below its bound: of
solids the radius of their dilation, of shells their spacing. What is fitted to dense points turns little from one to
the next, and the map may follow it; sparse ones, and gaps, say less than the base mesh does."""

POINT_SUFFIXES = (".ply", ".xyz", ".pts", ".pcd", ".pwn")
