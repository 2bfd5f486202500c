"""Evaluation of an asset's field blocks, the same code for every kind of field."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.asset.content import AssetContent, FieldBlock, values_of
from ndf_core.errors import AssetError
from ndf_core.kernels.field import FieldArrays, evaluate_field, evaluate_space_field


def field_arrays(block: FieldBlock) -> FieldArrays:
    """The block's numbers as the kernel takes them, without what it does with latent codes."""
    weights = [values_of(array) for array in block.weights]
    biases = [values_of(array) for array in block.biases]
    if block.latent is not None:
        weights[0] = np.ascontiguousarray(weights[0][:, : -block.latent_shape[1]])
    parts = [part.ravel() for layer in zip(weights, biases, strict=True) for part in layer]
    widths = [weights[0].shape[1], *(len(array) for array in biases)]
    return FieldArrays(
        base_frequency=block.encoding.base_frequency,
        levels=block.encoding.levels,
        include_position=block.encoding.include_position,
        features=np.ascontiguousarray(values_of(block.features)),
        widths=np.array(widths, dtype=np.int32),
        parameters=np.concatenate(parts),
        residual=block.residual,
    )


COLOR = "color"
"""Name of the field of the input's colours: red, green and blue in [0, 1]."""


class FieldEvaluator:
    """One field of an asset, ready to be evaluated many times. Answers are float32, in the box frame for lengths.

    Laws: rows are independent, so the answer does not depend on batches, order or `threads`.
    """

    def __init__(self, content: AssetContent, name: str = "displacement") -> None:
        if name not in content.fields:
            raise AssetError(f"the asset has no field {name!r}; it has {', '.join(sorted(content.fields))}")
        self.block = content.fields[name]
        self._content = content
        self._arrays = field_arrays(self.block)

    @property
    def widths(self) -> list[int]:
        """Inputs of the network, latent codes not counted, then outputs of every layer."""
        return [int(width) for width in self._arrays.widths]

    def at_base(
        self, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"], threads: int = 1
    ) -> Float[Array, "n k"]:
        """At points of the base mesh: face indices and barycentric weights in them; one code's columns after another.

        Raises:
            AssetError: the field is over space, or a face does not exist.
        """
        if self.block.domain != "base":
            raise AssetError(f"the field {self.block.name!r} is over space; evaluate it at points")
        try:
            content = self._content
            vertices = content.placed if self.block.kind == "displacement" else content.vertices
            parts = [
                evaluate_field(network, faces, barycentric, vertices, content.faces, threads)
                for network in self._networks()
            ]
        except (IndexError, ValueError) as error:
            raise AssetError(f"cannot evaluate the field {self.block.name!r}: {error}") from error
        return _side_by_side(parts)

    def at_points(self, points: Float[Array, "n 3"], threads: int = 1) -> Float[Array, "n k"]:
        """At points of the box frame.

        Raises:
            AssetError: the field is over the base mesh.
        """
        if self.block.domain != "space":
            raise AssetError(
                f"the field {self.block.name!r} is over the base mesh; give faces and barycentric weights"
            )
        try:
            parts = [evaluate_space_field(network, points, threads) for network in self._networks()]
        except ValueError as error:
            raise AssetError(f"cannot evaluate the field {self.block.name!r}: {error}") from error
        return _side_by_side(parts)

    def _networks(self) -> Iterator[FieldArrays]:
        """The network for each latent code: a code adds the same to the first layer everywhere, so to its bias."""
        latent = self.block.latent
        if latent is None:
            yield self._arrays
            return
        weights = values_of(self.block.weights[0])[:, -self.block.latent_shape[1] :]
        inputs, outputs = self.widths[:2]
        for code in values_of(latent):
            parameters = self._arrays.parameters.copy()
            parameters[inputs * outputs : (inputs + 1) * outputs] += weights @ code
            yield self._arrays._replace(parameters=parameters)


def _side_by_side(parts: list[Float[Array, "n k"]]) -> Float[Array, "n c"]:
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


def decoded(block: FieldBlock, outputs: Float[Array, "n k"]) -> Array:
    """What a field's outputs mean: values (n, k), truth values (n, k) for a binary one, or classes (n,)."""
    if block.kind == "binary":
        return outputs > 0
    return outputs.argmax(axis=1) if block.kind == "categorical" else outputs
