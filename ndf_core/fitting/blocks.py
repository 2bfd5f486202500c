"""From trained parameters to the asset's field blocks, and back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.asset.content import FieldBlock, Stored, values_of
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import NetworkShape, Parameters, displace, interpolate, invert

_CHUNK = 65_536


def field_blocks(shape: NetworkShape, stored: Callable[[str], Stored], keep_inverse: bool) -> dict[str, FieldBlock]:
    """The displacement block and, if wanted, the inverse. `stored` gives each named tensor as the file keeps it."""
    layers = range(shape.hidden_layers + 1)

    def block(name: str, network: str, features: Stored) -> FieldBlock:
        return FieldBlock(
            name=name,
            kind="displacement" if name == "displacement" else "inverse",
            domain="base" if name == "displacement" else "space",
            encoding=shape.encoding,
            features=features,
            weights=tuple(stored(f"{network}.weight.{i}") for i in layers),
            biases=tuple(stored(f"{network}.bias.{i}") for i in layers),
            activation="relu",
            residual=True,
        )

    blocks = {"displacement": block("displacement", "forward", stored("features"))}
    if keep_inverse:
        blocks["inverse"] = block("inverse", "inverse", np.zeros((shape.vertex_count, 0), np.float32))
    return blocks


def parameters_of(shape: NetworkShape, blocks: dict[str, FieldBlock], inverse_from: Parameters) -> Parameters:
    """Parameters with the numbers that the blocks stand for; an inverse that is not stored stays as it was."""
    parameters = Parameters(shape, inverse_from.flat.detach().cpu().clone())
    for name, network in (("displacement", "forward"), ("inverse", "inverse")):
        if name not in blocks:
            continue
        block = blocks[name]
        for i, (weight, bias) in enumerate(zip(block.weights, block.biases, strict=True)):
            parameters.views[f"{network}.weight.{i}"].copy_(torch.from_numpy(values_of(weight)))
            parameters.views[f"{network}.bias.{i}"].copy_(torch.from_numpy(values_of(bias)))
    parameters.features.copy_(torch.from_numpy(values_of(blocks["displacement"].features)))
    return parameters


class NumpyField:
    """Parameters seen as functions of numpy arrays, in chunks: what `measure` takes."""

    def __init__(self, parameters: Parameters, geometry: BaseGeometry) -> None:
        self._parameters = parameters
        self._geometry = geometry

    def map(self, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """g at base points, box frame."""
        geometry, parts = self._geometry, []
        for start in range(0, len(faces), _CHUNK):
            face, weights = self._tensors(faces[start : start + _CHUNK], barycentric[start : start + _CHUNK])
            features = interpolate(self._parameters.features, geometry.faces[face], weights)
            parts.append(displace(self._parameters, geometry.positions(face, weights), features).cpu().numpy())
        return np.concatenate(parts) if parts else np.zeros((0, 3), np.float32)

    def base(self, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """The base points themselves, box frame."""
        return self._geometry.positions(*self._tensors(faces, barycentric)).cpu().numpy()

    def inverse(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """The inverse network at box-frame points."""
        chunks = torch.from_numpy(points).float().to(self._geometry.device).split(_CHUNK)
        return torch.cat([invert(self._parameters, chunk) for chunk in chunks]).cpu().numpy()

    def _tensors(
        self, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        device = self._geometry.device
        face = torch.from_numpy(faces.astype(np.int64)).to(device)
        return face, torch.from_numpy(barycentric).float().to(device)
