"""What the checks look at: one representation and one source of it, opened step by step, each step once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from pydantic import BaseModel
from torch import Tensor

from ndf_core.api import RepresentationSpec
from ndf_core.base_mesh.checks import longest_side
from ndf_core.interfaces import BaseMesh, Projection, Surface
from ndf_core.mesh import face_normals
from ndf_core.plugins.discovery import Entry, claims
from ndf_core.plugins.guard import SECONDS, guarded
from ndf_core.plugins.loading import ask
from ndf_core.plugins.opening import open_surface
from ndf_core.testing.motion import Motion

POINTS = 256
"""Query points of the projector's laws; a multiple of four, so that halves of it have even length."""
_NEAR = 0.02
"""Queries lie up to so many longest sides off the base mesh."""

_IMPORT = """
import importlib, json, sys
importlib.import_module({module!r})
print()
print(json.dumps([*sys.modules]))
"""

Mover = Callable[[Any, Motion, Path], Any]
"""``moved(source, motion, folder)``: the same shape, moved; None where the format cannot express this motion."""


@dataclass
class Subject:
    """Properties raise what the plugin raises; each belongs to one check, which all others need."""

    name: str
    source: Any
    """None: only what needs no source is checked."""
    folder: Path
    """For files that checks write."""
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Of the representation; tables as nested mappings."""
    moved: Mover | None = None
    tolerance: float = 1e-4
    """How far a projection may be off, as a share of the longest side."""
    faces: int = 300

    @cached_property
    def entry(self) -> Entry:
        return claims(self.name)[0]

    @cached_property
    def spec(self) -> RepresentationSpec:
        return guarded(lambda: ask(self.entry), f"importing {self.entry.target}")

    @cached_property
    def imported(self) -> tuple[str, list[str]]:
        """What a fresh interpreter prints on importing the entry module, and all modules that it then has."""
        command = [sys.executable, "-P", "-c", _IMPORT.format(module=self.entry.target.partition(":")[0])]
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
        if done.returncode:
            last = done.stderr.strip().rpartition("\n")[2]
            raise ImportError(f"importing {self.entry.target} fails in a fresh interpreter: {last}")
        printed, _, names = done.stdout.rstrip("\n").rpartition("\n")
        return printed.strip(), json.loads(names)

    @cached_property
    def config(self) -> BaseModel:
        return self.spec.config.model_validate(self.options)

    @property
    def path(self) -> Path | None:
        """The source where it is a file or folder."""
        given = self.source if isinstance(self.source, (str, Path)) else None
        return Path(given) if given is not None and Path(given).exists() else None

    @cached_property
    def surface(self) -> Surface:
        return self.opened(self.source)

    @cached_property
    def surface_again(self) -> Surface:
        """Opened a second time, by a relative path where it has one."""
        return self.opened(self.source if self.path is None else _relative(self.path))

    def opened(self, source: Any) -> Surface:
        return open_surface(self.spec, source, self.config)

    @cached_property
    def base_mesh(self) -> BaseMesh:
        return self.surface.base_mesh.extract(self.faces)

    @cached_property
    def size(self) -> float:
        """Longest side of the base mesh."""
        return longest_side(self.base_mesh.vertices)

    @cached_property
    def places(self) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
        """Points near the base mesh, even by area, and the outward unit normals of the faces that they are from."""
        rng = np.random.default_rng(0)
        vertices, faces = self.base_mesh.vertices, self.base_mesh.faces
        normals = face_normals(vertices, faces)
        areas = np.linalg.norm(normals, axis=1)
        chosen = rng.choice(len(faces), POINTS, p=areas / areas.sum())
        outward = normals[chosen] / areas[chosen, None]
        weights = rng.dirichlet((1.0, 1.0, 1.0), POINTS)
        points = np.einsum("nc,ncx->nx", weights, vertices[faces[chosen]])
        return points + rng.uniform(-_NEAR, _NEAR, (POINTS, 1)) * self.size * outward, outward

    @cached_property
    def queries(self) -> Float[Tensor, "n 3"]:
        return torch.from_numpy(self.places[0])

    @cached_property
    def directions(self) -> Float[Tensor, "n 3"]:
        """What a mapped surface would have as normals there."""
        return torch.from_numpy(self.places[1])

    @cached_property
    def answer(self) -> Projection:
        return self.project(self.queries, self.directions)

    def project(self, points: Tensor, directions: Tensor, surface: Surface | None = None) -> Projection:
        """Ask the projector, of another surface if one is given; what it does to its input stays with it."""
        projector = (surface or self.surface).projector
        return projector.project(points.clone(), directions.clone() if projector.needs_directions else None)

    @cached_property
    def far_queries(self) -> tuple[Float[Tensor, "m 3"], Float[Tensor, "m 3"]]:
        """Points that no fit asks for, and directions: far away, and in the middle."""
        rng = np.random.default_rng(1)
        away = rng.standard_normal((32, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        distances = self.size * np.r_[np.full(16, 3.0), np.full(15, 30.0), 0.0]
        middle = (self.base_mesh.vertices.min(axis=0) + self.base_mesh.vertices.max(axis=0)) / 2
        return torch.from_numpy(middle + distances[:, None] * away), torch.from_numpy(away)


def _relative(path: Path) -> str:
    try:
        return os.path.relpath(path)
    except ValueError:  # on another drive
        return str(path)
