"""What a representation implements: a `BaseMeshExtractor`, a `Projector`, and the `Surface` that holds both.

Plugins speak the units of their input throughout. The core owns the box [-1.5, 1.5]^3 of App. A.1 and maps
points to input units before it calls a plugin, and back afterwards.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from torch import Tensor


class Projection(NamedTuple):
    """Answer of a `Projector`, one row per query point, in input units.

    Rows that did not converge hold finite numbers but mean nothing; the trainer leaves them out and counts them.
    """

    points: Float[Tensor, "n 3"]
    converged: Bool[Tensor, " n"]
    normals: Float[Tensor, "n 3"] | None
    """Outward unit surface normals at `points`, or None where the representation has none."""


class Projector(ABC):
    """Maps points near the surface onto it (paper Sec. 3.2 eq. projection, Sec. 4.2).

    Laws: `project` is pure (rows are independent, nothing is cached between calls, the input is not modified);
    points on the surface stay; projecting twice is projecting once, up to the representation's tolerance;
    dtype and device of the answer are those of the query.
    """

    needs_directions: bool = False
    """Whether `project` needs `directions`, the unit normals n_theta of the mapped surface (NeRF, App. D)."""
    parallel: bool = False
    """Whether many points are projected faster in parts, each on a thread of its own. So it is where time goes into
    long operations without Python's lock; of many short ones, two threads take twice the time of one."""

    @abstractmethod
    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        """Project `points` (float64, input units) onto the surface.

        Raises:
            InputError: a query point is not finite.
        """


@dataclass(frozen=True)
class Remark:
    """One thing that the base mesh lost or changed against the surface, for the report; never silent."""

    kind: str
    """Short slug: "dropped_component", "filled_handle", "self_intersections", "faces_not_reached", ..."""
    message: str
    position: tuple[float, float, float] | None = None
    """Where, in input units."""
    size: float | None = None
    """How large (bounding-box diagonal of the place), in input units."""
    count: int = 1


@dataclass(frozen=True)
class BaseMesh:
    """A coarse manifold, consistently oriented triangle mesh in input units (the paper's Omega')."""

    vertices: Float[Array, "v 3"]
    """float64, input units."""
    faces: Int[Array, "f 3"]
    """int32, counter-clockwise seen from outside."""
    remarks: tuple[Remark, ...] = ()


class BaseMeshExtractor(ABC):
    """Makes the base mesh (paper Sec. 4.1).

    Laws: the mesh is finite, manifold (edges and vertices), consistently oriented with normals pointing
    outwards, has no degenerate face and at most `max_faces` faces (a remark of kind "faces_not_reached" says why
    it has more), and is the same for the same arguments.
    """

    @abstractmethod
    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        """Return the base mesh.

        Raises:
            BaseMeshError: the surface has no closed level set, or no manifold mesh could be made.
        """


class ColoredPoints(NamedTuple):
    """Points on or near the surface with their colours, input units."""

    points: Float[Array, "n 3"]
    colors: Float[Array, "n 3"]
    """Red, green, blue in [0, 1]."""


@dataclass(frozen=True)
class Surface:
    """An opened input: what `ndf_core.open` returns and `ndf_core.fit` takes."""

    representation: str
    """The `--repr` name."""
    base_mesh: BaseMeshExtractor
    projector: Projector
    fingerprint: str
    """SHA-256 (hex) over the input's content and the representation's config; no path, no time."""
    training_defaults: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Fit options that this representation changes, nested as in `FitConfig` (Table 3 weights)."""
    sample: Callable[[int, np.random.Generator], tuple[Array, Array | None]] | None = None
    """``sample(n, rng) -> (points (n, 3), normals (n, 3) or None)``, even by area on the surface itself, in input
    units; None where the surface cannot be sampled directly. Only measuring uses it, never fitting."""
    notes: tuple[str, ...] = ()
    """One-line remarks for the user about how the input was read."""
    colors: Callable[[], ColoredPoints | None] | None = None
    """The colours that the input has, read when asked for; None, or a None from it, where it has none."""
    plugin: str = ""
    """Distribution and version that read the input, for the provenance; `ndf_core.open` fills it in."""
