"""Evaluation of an asset's field blocks, the same code for every kind of field."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.asset.content import AssetContent, FieldBlock, values_of
from ndf_core.errors import AssetError
from ndf_core.kernels.field import FieldArrays, evaluate_field, evaluate_space_field


def field_arrays(block: FieldBlock) -> FieldArrays:
    """The block's numbers as the kernel takes them."""
    weights = [values_of(array) for array in block.weights]
    biases = [values_of(array) for array in block.biases]
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
        """Inputs of the network, then outputs of every layer."""
        return [int(width) for width in self._arrays.widths]

    def at_base(
        self, faces: Int[Array, " n"], barycentric: Float[Array, "n 3"], threads: int = 1
    ) -> Float[Array, "n k"]:
        """At points of the base mesh: face indices and barycentric weights in them.

        Raises:
            AssetError: the field is over space, or a face does not exist.
        """
        if self.block.domain != "base":
            raise AssetError(f"the field {self.block.name!r} is over space; evaluate it at points")
        try:
            return evaluate_field(
                self._arrays, faces, barycentric, self._content.vertices, self._content.faces, threads
            )
        except (IndexError, ValueError) as error:
            raise AssetError(f"cannot evaluate the field {self.block.name!r}: {error}") from error

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
            return evaluate_space_field(self._arrays, points, threads)
        except ValueError as error:
            raise AssetError(f"cannot evaluate the field {self.block.name!r}: {error}") from error
