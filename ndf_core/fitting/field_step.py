"""Value and gradient of a learned field's network (Sec. 3.5), written out by hand as in `step`.

A latent code adds the same to the first layer at every point, so that layer is computed once for all fields.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.fitting.network import NetworkShape, Parameters
from ndf_core.fitting.step import Batch, NetworkInputs, Pass


class FieldStep:
    """Forward and backward pass of the forward network for batches of one size."""

    def __init__(
        self,
        shape: NetworkShape,
        batch: int,
        device: torch.device | str = "cpu",
        gradient: Parameters | None = None,
    ) -> None:
        self.gradient = gradient or Parameters.zeros(shape, device)
        self._shape = shape
        self._fields = max(1, shape.latent[0])
        self._inputs = NetworkInputs(shape, batch, device)
        self._alone = torch.empty(batch, shape.hidden_width, device=device)
        self._hidden = torch.empty(self._fields, batch, shape.hidden_width, device=device)
        sizes = shape.layer_sizes(shape.feature_dim + shape.latent[1])
        self._rest = Pass("forward", sizes[1:], self._hidden.view(-1, shape.hidden_width), first=1)

    def evaluate(self, parameters: Parameters, batch: Batch) -> Float[Tensor, "k n o"]:
        """Outputs for each latent code (k = 1 without any) and base point; keeps the activations for `backward`.

        The answer is overwritten by the next call.
        """
        self._inputs.fill(parameters, batch)
        weight, bias = parameters.layers("forward")[0]
        seen = self._inputs.rows.shape[1]
        torch.addmm(bias, self._inputs.rows, weight[:, :seen].t(), out=self._alone)
        if self._shape.latent[0]:
            shift = parameters.views["latent"] @ weight[:, seen:].t()
            torch.add(self._alone[None], shift[:, None], out=self._hidden)
        else:
            self._hidden[0].copy_(self._alone)
        self._hidden.relu_()
        return self._rest.run(parameters).view(self._fields, len(self._alone), -1)

    def backward(self, parameters: Parameters, batch: Batch, output_gradient: Float[Tensor, "k n o"]) -> None:
        """Add the gradient to `gradient`, given that of the outputs. Call `evaluate` first."""
        above = output_gradient.reshape(-1, output_gradient.shape[2])
        into_hidden = self._rest.pull_back(parameters, self.gradient, above, 0).view_as(self._hidden)
        torch.ops.aten.threshold_backward(into_hidden, self._hidden, 0.0, grad_input=into_hidden)
        weight = parameters.layers("forward")[0][0]
        weight_slot, bias_slot = self.gradient.layers("forward")[0]
        rows, start = self._inputs.rows, self._shape.encoding.width
        seen = rows.shape[1]
        into_alone = into_hidden[0] if self._fields == 1 else into_hidden.sum(0)
        weight_slot[:, :seen].addmm_(into_alone.t(), rows)
        bias_slot.add_(into_alone.sum(0))
        if self._shape.latent[0]:
            by_code = into_hidden.sum(1)
            weight_slot[:, seen:].addmm_(by_code.t(), parameters.views["latent"])
            self.gradient.views["latent"].addmm_(by_code, weight[:, seen:])
        self._inputs.pull_back(self.gradient, batch, into_alone @ weight[:, start:seen])
