"""Value and gradient of the projection and cycle losses, written out by hand: the hot loop of fitting.

Autograd computes the same numbers (`network.displace` and `network.invert` are the reference that the tests compare
with), but allocates and faults in several megabytes for every activation; here every buffer is reused, the first
layer's input gradient is taken for the features alone, and relu works in place. The same code runs on CUDA.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ndf_core.fitting.network import NetworkShape, Parameters, frequency_matrix


class Batch(NamedTuple):
    """Base points, box frame."""

    corners: Int[Tensor, "n 3"]
    """Vertex indices of each point's face."""
    barycentric: Float[Tensor, "n 3"]
    positions: Float[Tensor, "n 3"]


_TILE = 8192


def tile_size(batch: int, device: torch.device | str) -> int:
    """Rows that a step takes at once: on the CPU few enough for the activations to stay in cache."""
    return batch if torch.device(device).type != "cpu" else min(batch, _TILE)


class FusedStep:
    """Forward and backward pass for batches of one size. Not re-entrant: one instance per thread."""

    def __init__(
        self,
        shape: NetworkShape,
        batch: int,
        cycle_stride: int,
        device: torch.device | str = "cpu",
        gradient: Parameters | None = None,
    ) -> None:
        self.shape = shape
        cycle_stride = min(cycle_stride, batch)
        cycle_batch = batch // cycle_stride
        self.gradient = gradient or Parameters.zeros(shape, device)
        self.mapped = torch.empty(batch, 3, device=device)
        self._matrix, self._phase = frequency_matrix(shape.encoding, device)
        self._inputs = NetworkInputs(shape, batch, device)
        self._forward = Pass("forward", shape.layer_sizes(shape.feature_dim), self._inputs.rows)
        inverse = torch.empty(cycle_batch, shape.encoding.width, device=device)
        self._inverse = Pass("inverse", shape.layer_sizes(0), inverse)
        self._cycle_stride = cycle_stride
        self._cosines = torch.empty(cycle_batch, 6 * shape.encoding.levels, device=device)

    def map(self, parameters: Parameters, batch: Batch) -> Float[Tensor, "n 3"]:
        """g(x) of the whole batch; keeps the activations for `backward`."""
        self._inputs.fill(parameters, batch)
        torch.add(batch.positions, self._forward.run(parameters), out=self.mapped)
        return self.mapped

    def backward(
        self,
        parameters: Parameters,
        batch: Batch,
        output_gradient: Float[Tensor, "n 3"],
        cycle_weight: float,
        turn: int = 0,
    ) -> Float[Tensor, ""]:
        """Add the whole gradient to `gradient` and return the mean cycle loss. Call `map` first.

        `output_gradient` is dL/dg of the other losses and is changed. The cycle loss is taken on every
        `cycle_stride`-th row; `cycle_weight` multiplies its mean. Batches come sorted by face, so each step has to
        start at another row (`turn`, the step's number), or some faces would never be among them.
        """
        # A stride that does not divide the batch leaves some rows at the end: more starts reach them as well.
        first = turn % (len(self.mapped) - (len(self._cosines) - 1) * self._cycle_stride)
        loss = self._cycle(parameters, batch.positions, output_gradient, cycle_weight, first)
        self._pull_back(parameters, batch, output_gradient)
        return loss

    def identity(self, parameters: Parameters, batch: Batch, weight: float) -> None:
        """Add the gradient of `weight` times both networks' mean squared distance from the identity (App. A.1)."""
        residual = self.map(parameters, batch).sub_(batch.positions)
        self._pull_back(parameters, batch, residual.mul_(2.0 * weight / len(residual)))
        self.mapped.copy_(batch.positions)
        self._cycle(parameters, batch.positions, torch.empty_like(batch.positions), weight, 0)

    def _pull_back(self, parameters: Parameters, batch: Batch, output_gradient: Tensor) -> None:
        into_features = self._forward.pull_back(parameters, self.gradient, output_gradient, self.shape.encoding.width)
        self._inputs.pull_back(self.gradient, batch, into_features)

    def _cycle(
        self, parameters: Parameters, positions: Tensor, output_gradient: Tensor, weight: float, start: int
    ) -> Tensor:
        count = len(self._cosines)
        rows = slice(start, start + (count - 1) * self._cycle_stride + 1, self._cycle_stride)
        encoding = self.shape.encoding
        first = encoding.width - 6 * encoding.levels
        mapped, inputs = self.mapped[rows], self._inverse.inputs
        inputs[:, :first] = mapped[:, :first]
        torch.addmm(self._phase, mapped, self._matrix, out=self._cosines)
        torch.sin(self._cosines, out=inputs[:, first:])
        self._cosines.cos_()
        residual = self._inverse.run(parameters) + mapped - positions[rows]
        loss = residual.square().sum() / count
        residual.mul_(2.0 * weight / count)
        into_inputs = self._inverse.pull_back(parameters, self.gradient, residual, 0)
        into_waves = into_inputs[:, first:].mul_(self._cosines)
        target = output_gradient[rows]
        target.addmm_(into_waves, self._matrix.t())
        target.add_(residual)
        if first:
            target.add_(into_inputs[:, :first])
        return loss


class NetworkInputs:
    """What the forward network sees of a batch: encoded positions, then features. One row for each base point."""

    def __init__(self, shape: NetworkShape, batch: int, device: torch.device | str) -> None:
        self._shape = shape
        self._matrix, self._phase = frequency_matrix(shape.encoding, device)
        self._corner_rows = torch.empty(3 * batch, shape.feature_dim, device=device)
        self.rows = torch.empty(batch, shape.encoding.width + shape.feature_dim, device=device)

    def fill(self, parameters: Parameters, batch: Batch) -> None:
        """Set `rows`."""
        encoding, inputs = self._shape.encoding, self.rows
        if encoding.include_position:
            inputs[:, :3] = batch.positions
        waves = inputs[:, encoding.width - 6 * encoding.levels : encoding.width]
        torch.addmm(self._phase, batch.positions, self._matrix, out=waves)
        waves.sin_()
        if self._shape.feature_dim:
            torch.index_select(parameters.features, 0, batch.corners.view(-1), out=self._corner_rows)
            corners = self._corner_rows.view(-1, 3, self._shape.feature_dim)
            torch.bmm(batch.barycentric[:, None, :], corners, out=inputs[:, None, encoding.width :])

    def pull_back(self, gradient: Parameters, batch: Batch, into_features: Float[Tensor, "n d"]) -> None:
        """Add to the features' gradient, given that of the interpolated ones."""
        if self._shape.feature_dim:
            spread = self._corner_rows.view(-1, 3, self._shape.feature_dim)
            torch.mul(batch.barycentric[:, :, None], into_features[:, None, :], out=spread)
            gradient.features.index_add_(0, batch.corners.view(-1), self._corner_rows)


class Pass:
    """Activations of one network, from its layer `first` on, for one number of rows."""

    def __init__(self, network: str, sizes: list[tuple[int, int]], inputs: Tensor, first: int = 0) -> None:
        """`sizes` are (out, in) of the layers that it runs, `inputs` the rows that the first of them sees."""
        self.network, self.inputs, self._first = network, inputs, first
        self.outputs = [inputs.new_empty(len(inputs), out) for out, _ in sizes]
        self.back = [inputs.new_empty(len(inputs), into) for _, into in sizes]

    def run(self, parameters: Parameters) -> Tensor:
        below = self.inputs
        layers = parameters.layers(self.network)[self._first :]
        for index, ((weight, bias), out) in enumerate(zip(layers, self.outputs, strict=True)):
            torch.addmm(bias, below, weight.t(), out=out)
            if index + 1 < len(layers):
                out.relu_()
            below = out
        return below

    def pull_back(self, parameters: Parameters, gradient: Parameters, above: Tensor, first_column: int) -> Tensor:
        """Add to this network's gradient; return dL/d inputs[:, first_column:]."""
        layers = parameters.layers(self.network)[self._first :]
        slots = gradient.layers(self.network)[self._first :]
        for index in reversed(range(len(layers))):
            below = self.outputs[index - 1] if index else self.inputs
            slots[index][0].addmm_(above.t(), below)
            slots[index][1].add_(above.sum(0))
            weight = layers[index][0] if index else layers[0][0][:, first_column:]
            into = self.back[index] if index else self.back[0][:, first_column:]
            torch.mm(above, weight, out=into)
            if index:
                # relu's derivative from its output, in place: zero where the unit is off.
                torch.ops.aten.threshold_backward(into, below, 0.0, grad_input=into)
            above = into
        return above
