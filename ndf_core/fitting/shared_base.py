"""A base mesh that another asset has, to be fitted onto a surface of the same topology (App. D.1)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from ndf_core.asset.asset import Asset
from ndf_core.asset.base_mesh_codec import BOX_SIDE
from ndf_core.asset.placement import Placement
from ndf_core.base_mesh.checks import longest_side
from ndf_core.base_mesh.quantise import EncodedBaseMesh
from ndf_core.config.fit import FitConfig
from ndf_core.errors import BaseMeshError, FitError
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.losses import Anchors
from ndf_core.fitting.network import Parameters
from ndf_core.fitting.optimizer import Optimizer, rate_factor
from ndf_core.fitting.registration import PlacedAnchors, Target, nearest_rotation, register
from ndf_core.fitting.sampling import base_points_at, generator_at, stratified
from ndf_core.fitting.sphere_map import SphereMap
from ndf_core.fitting.step import FusedStep, tile_size
from ndf_core.interfaces import BaseMesh
from ndf_core.mesh import face_normals, interpolate, topology

TARGET_FACES = 20_000
"""Size of the mesh that stands for the surface while the base mesh is drawn over it."""
MOST_FOLDED = 1e-3
"""Share of the area."""


class SharedBase:
    """The base mesh of an asset, and the surface points that anchors name."""

    def __init__(self, path: Path, pairs: Float[Array, "m 6"]) -> None:
        """`pairs` are points on the surface of the asset, in its units, and their targets, in the new surface's.

        Raises:
            AssetError, InputError: the asset cannot be read.
        """
        self._asset = Asset.load(path)
        self._path, self._pairs = path, pairs
        self._anchors = self._asset.locate(pairs[:, :3])[:2]

    @property
    def fingerprint(self) -> str:
        """SHA-256 (hex, shortened) of the base mesh: what a run is known by, wherever the asset lies."""
        return hashlib.sha256(self._asset.content.base_mesh_blob).hexdigest()[:32]

    def placed(
        self, mesh: BaseMesh, seed: int, say: Callable[[str], None]
    ) -> tuple[EncodedBaseMesh, SphereMap | None]:
        """The base mesh on `mesh`, a mesh of the new surface; bytes, vertices and faces are the asset's.

        It is registered, or drawn on a common sphere where that folds; then the second is the map that it follows.

        Raises:
            BaseMeshError: the two have not the same topology.
            FitError: the base mesh collapses on the surface.
        """
        content = self._asset.content
        faces = content.faces
        own, theirs = topology(faces, len(content.vertices)), topology(mesh.faces, len(mesh.vertices))
        if (own.components, own.euler_characteristic) != (theirs.components, theirs.euler_characteristic):
            raise BaseMeshError(
                f"the base mesh of {self._path} has {own.components} component(s) and Euler characteristic "
                f"{own.euler_characteristic}, the input {theirs.components} and {theirs.euler_characteristic}: "
                f"a map needs the same topology"
            )
        center = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
        scale = longest_side(mesh.vertices) / BOX_SIDE
        base = EncodedBaseMesh(content.base_mesh_blob, content.vertices, faces, center, scale, bits=0)
        target = Target((mesh.vertices - center) / scale, mesh.faces)
        anchors = PlacedAnchors(*self._anchors, self._goals(base))
        shape = content.placed
        starts = interpolate(shape, faces[anchors.faces], anchors.weights)
        turn = nearest_rotation(starts - starts.mean(axis=0), anchors.goals - anchors.goals.mean(axis=0))
        positions, sphere_map = register(shape @ turn, faces, target, anchors, seed), None
        folded = _folded(positions, faces, target)
        if folded > MOST_FOLDED and own.components == 1 and own.genus == 0:
            try:
                sphere_map = SphereMap(shape, faces, target, anchors)
                positions = sphere_map.vertices
            except FitError as error:
                say(f"{error}; the map starts with {folded:.2%} of its area folded")
        return replace(base, placement=Placement.of(positions, faces)), sphere_map

    def anchors(self, geometry: BaseGeometry, base: EncodedBaseMesh) -> Anchors:
        """The pairs in the box frame."""
        return Anchors(
            base_points_at(geometry, *self._anchors), torch.from_numpy(self._goals(base)).float().to(geometry.device)
        )

    def _goals(self, base: EncodedBaseMesh) -> Float[Array, "m 3"]:
        return (self._pairs[:, 3:] - base.center) / base.scale


def _folded(positions: Float[Array, "v 3"], faces: Int[Array, "f 3"], target: Target) -> float:
    """Share of the area."""
    areas = np.linalg.norm(face_normals(positions, faces), axis=1)
    return float(areas[target.folded(positions, faces)].sum() / areas.sum())


def follow(parameters: Parameters, geometry: BaseGeometry, start: SphereMap, config: FitConfig) -> None:
    """Train the map to `start`, and the inverse to it, in place: it is not linear on faces, as the placed mesh is."""
    config = config.model_copy(update={"steps": start.steps})

    def goals(face: Int[Tensor, " n"], barycentric: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        points = start.at(face.cpu().numpy(), barycentric.double().cpu().numpy())
        return torch.from_numpy(points).float().to(geometry.device)

    tile = tile_size(config.batch, geometry.device)
    step = FusedStep(parameters.shape, tile, config.cycle_stride, geometry.device)
    optimizer = Optimizer(parameters, config)
    for count in range(start.steps):
        base = stratified(geometry, geometry.areas, tile, generator_at(config.seed, -2 - count))
        step.gradient.flat.zero_()
        residual = step.map(parameters, base.batch) - goals(base.face, base.barycentric)
        residual.mul_(2 * config.loss.projection / len(residual))
        step.backward(parameters, base.batch, residual, config.loss.cycle, count)
        optimizer.step(step.gradient, rate_factor(config, count))
