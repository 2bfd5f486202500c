"""Tiny surfaces with exact projectors, and projectors with faults; what small fits and fields are made from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from small_assets import Mesh, icosphere, torus
from torch import Tensor

from ndf_core.asset.content import Encoding
from ndf_core.config.fit import FitConfig
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import NetworkShape, Parameters
from ndf_core.interfaces import BaseMesh, BaseMeshExtractor, Projection, Projector, Remark, Surface

CENTER = (10.0, -4.0, 2.0)
RADIUS = 2.5


def tiny_config(**options: Any) -> FitConfig:
    """Every option that decides how long a fit takes or where it ends, so that no test hangs on a default."""
    fixed = {
        "faces": 100,
        "steps": 30,
        "batch": 200,
        "threads": 1,
        "device": "cpu",
        "hidden_width": 16,
        "hidden_layers": 2,
        "encoding_levels": 3,
        "feature_dim": 4,
        "sampling": "stratified",
        "resample_every": 1,
        "coverage_every": 0,
        "cycle_stride": 2,
        "identity_steps": 0,
        "feature_scale": 0.5,
        "frequency_damping": 0.5,
        "optimizer": "muon",
        "learning_rate": 4e-3,
        "feature_learning_rate": 1e-1,
        "adam_beta2": 0.99,
        "schedule": "cosine",
        "warmup_steps": 5,
        "keep_inverse": True,
        "checkpoint_seconds": 1e6,
        "loss": {"projection": 1e4, "cycle": 1e2},
    }
    return FitConfig.model_validate(fixed | options)


class SphereProjector(Projector):
    """Closest point of a sphere."""

    def __init__(self, center: tuple[float, float, float] = CENTER, radius: float = RADIUS) -> None:
        self._center = torch.tensor(center, dtype=torch.float64)
        self._radius = radius

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        assert points.dtype == torch.float64
        normals = torch.nn.functional.normalize(points - self._center, dim=1)
        found = self._center + self._radius * normals
        return Projection(found, torch.ones(len(points), dtype=torch.bool), normals)


class TorusProjector(Projector):
    """Closest point of a torus around the z axis through the origin."""

    def __init__(self, large: float = 1.0, small: float = 0.4) -> None:
        self._large, self._small = large, small

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        circle = self._large * torch.nn.functional.normalize(points * torch.tensor([1.0, 1.0, 0.0]), dim=1)
        normals = torch.nn.functional.normalize(points - circle, dim=1)
        return Projection(circle + self._small * normals, torch.ones(len(points), dtype=torch.bool), normals)


class Altered(Projector):
    """`inner` with its answer passed through `change(query, answer)`; keeps the directions that it was given."""

    def __init__(
        self,
        inner: Projector,
        change: Callable[[Tensor, Projection], Projection],
        *,
        needs_directions: bool = False,
    ) -> None:
        self._inner, self._change = inner, change
        self.needs_directions = needs_directions
        self.directions: list[Tensor | None] = []

    def project(self, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"] | None = None) -> Projection:
        self.directions.append(directions)
        return self._change(points, self._inner.project(points, directions))


def upper(points: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
    """Rows above the sphere's equator."""
    return points[:, 2] > CENTER[2]


def upper_half_fails(query: Tensor, answer: Projection) -> Projection:
    """Rows of the upper half do not converge, and hold finite nonsense."""
    bad = upper(query)[:, None]
    assert answer.normals is not None
    return Projection(
        torch.where(bad, 1e6, answer.points), answer.converged & ~bad[:, 0], torch.where(bad, 7.0, answer.normals)
    )


def upper_half_is_nan(query: Tensor, answer: Projection) -> Projection:
    """Rows of the upper half are NaN, against the contract, and said to have converged."""
    bad = upper(query)[:, None]
    assert answer.normals is not None
    nan = float("nan")
    return Projection(torch.where(bad, nan, answer.points), answer.converged, torch.where(bad, nan, answer.normals))


def upper_half_stays(query: Tensor, answer: Projection) -> Projection:
    """Rows of the upper half are their own projections: no residual."""
    return answer._replace(points=torch.where(upper(query)[:, None], query, answer.points))


def nothing_converges(query: Tensor, answer: Projection) -> Projection:
    return answer._replace(converged=torch.zeros_like(answer.converged))


def overflows(query: Tensor, answer: Projection) -> Projection:
    """Finite, and the square of the distance is not."""
    return answer._replace(points=torch.full_like(query, 1e30))


def without_normals(query: Tensor, answer: Projection) -> Projection:
    return answer._replace(normals=None)


class GivenMesh(BaseMeshExtractor):
    """A base mesh made elsewhere."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    def extract(self, max_faces: int, seed: int = 0) -> BaseMesh:
        remark = Remark("dropped_component", "a crumb was dropped", (1.0, 2.0, 3.0), 0.25, 2)
        return BaseMesh(self._mesh[0], self._mesh[1].astype(np.int32), (remark,))


def sphere_mesh(subdivisions: int = 1) -> Mesh:
    """An icosphere inscribed in the sphere of `SphereProjector()`."""
    points, faces = icosphere(subdivisions)
    return points * RADIUS + np.array(CENTER), faces


def sphere_surface(
    projector: Projector | None = None, *, subdivisions: int = 1, fingerprint: str = "a5" * 32
) -> Surface:
    """The sphere over an icosphere; `projector` may be one with a fault."""

    def sample(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        normals = rng.normal(size=(count, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals * RADIUS + np.array(CENTER), normals

    mesh = GivenMesh(sphere_mesh(subdivisions))
    return Surface("sphere", mesh, projector or SphereProjector(), fingerprint, sample=sample)


def torus_surface() -> Surface:
    """Genus 1; cannot be sampled."""
    return Surface("torus", GivenMesh(torus()), TorusProjector(), "70" * 32)


def small_geometry(mesh: Mesh | None = None) -> BaseGeometry:
    """In the box frame: an icosphere of 80 faces, unless another mesh is given."""
    points, faces = icosphere() if mesh is None else mesh
    return BaseGeometry(points, faces.astype(np.int32))


def in_double(geometry: BaseGeometry) -> BaseGeometry:
    """The same in float64, so that finite differences tell a wrong derivative from rounding."""
    for name in ("vertices", "areas", "corner_positions"):
        setattr(geometry, name, getattr(geometry, name).double())
    return geometry


def random_parameters(
    geometry: BaseGeometry,
    *,
    levels: int = 3,
    feature_dim: int = 4,
    hidden_layers: int = 2,
    width: int = 16,
    size: float = 0.3,
    seed: int = 0,
) -> Parameters:
    """A rough field: nothing is zero, displacements are of about `size`."""
    encoding = Encoding(base_frequency=1.0, levels=levels, include_position=True)
    shape = NetworkShape(encoding, width, hidden_layers, len(geometry.vertices), feature_dim)
    parameters = Parameters.initial(shape, seed, zero_last=False, feature_scale=1.0)
    for network in ("forward", "inverse"):
        for tensor in parameters.layers(network)[-1]:
            tensor.mul_(size / 0.3)
    return parameters


def doubled(parameters: Parameters) -> Parameters:
    return Parameters(parameters.shape, parameters.flat.double())


def affine_parameters(
    geometry: BaseGeometry,
    matrix: Float[Array, "3 3"] | None = None,
    offsets: Float[Array, "v 3"] | None = None,
) -> Parameters:
    """The field g(x) = matrix x + offsets(x), with offsets linear over each face; inputs stay above -8.

    ReLU passes v = relu(v + 8) - 8, so that a network of width 6 can copy x and three features.
    """
    shape = NetworkShape(Encoding(1.0, 0, include_position=True), 6, 1, len(geometry.vertices), 3)
    parameters = Parameters.zeros(shape)
    linear = torch.eye(3) if matrix is None else torch.from_numpy(matrix).float()
    out = torch.cat([linear - torch.eye(3), torch.eye(3)], dim=1)
    parameters.views["forward.weight.0"].copy_(torch.eye(6))
    parameters.views["forward.bias.0"].fill_(8)
    parameters.views["forward.weight.1"].copy_(out)
    parameters.views["forward.bias.1"].copy_(-8 * out.sum(1))
    if offsets is not None:
        parameters.features.copy_(torch.from_numpy(offsets))
    return parameters


def base_points(geometry: BaseGeometry, count: int, seed: int = 0) -> tuple[Tensor, Tensor]:
    """Random faces and barycentric weights, in the geometry's precision."""
    rng = np.random.default_rng(seed)
    face = torch.from_numpy(np.sort(rng.integers(0, len(geometry.faces), count)))
    return face, torch.from_numpy(rng.dirichlet((1.0, 1.0, 1.0), count)).to(geometry.vertices.dtype)
