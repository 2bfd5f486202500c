"""Where the map is still far from the surface, so that samples go there.

The loss is an integral over the mapped surface of the squared distance, and its gradient is as large as the distance.
An estimate from random samples has the least noise where they are drawn in proportion to that and weigh the less for
it. How far a face is from the surface is known from the samples of the steps before.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

_KEPT = 0.97
"""Share of what is known about a face that counts one step later: some thirty steps are remembered."""


class FaceErrors:
    """Mean squared distance from the surface in each face of the base mesh, over the last steps."""

    def __init__(self, face_count: int, device: torch.device | str) -> None:
        self._squared = torch.zeros(face_count, device=device)
        self._samples = torch.zeros(face_count, device=device)

    @property
    def state(self) -> dict[str, Tensor]:
        """Tensors of a checkpoint."""
        return {"errors.squared": self._squared, "errors.samples": self._samples}

    def load_state(self, state: dict[str, Tensor]) -> None:
        self._squared.copy_(state["errors.squared"])
        self._samples.copy_(state["errors.samples"])

    def add(self, face: Int[Tensor, " n"], squared: Float[Tensor, " n"], known: Bool[Tensor, " n"]) -> None:
        """Take in the squared distances of a step's samples, where they are `known`."""
        weight = known.to(squared.dtype)
        self._squared.mul_(_KEPT).index_add_(0, face, squared * weight)
        self._samples.mul_(_KEPT).index_add_(0, face, weight)

    def density(self, areas: Float[Tensor, " f"], share: float) -> Float[Tensor, " f"]:
        """By how much to sample each face more densely than the others; the mean over `areas` is 1.

        `share` of all samples follow the rms distance, the others the mapped area alone, so no face goes without.
        """
        # As if every face had one more sample of the usual error: few samples say little.
        usual = self._squared.sum() / self._samples.sum()
        rms = ((self._squared + usual) / (self._samples + 1)).sqrt()
        mean = (areas * rms).sum() / areas.sum()
        # Neither before the first samples, where the mean is not a number, nor of an exact fit.
        return 1 - share + share * rms / mean if mean > 0 else torch.ones_like(areas)
