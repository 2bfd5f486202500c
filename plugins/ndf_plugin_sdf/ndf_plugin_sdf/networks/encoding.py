"""The positional encoding in front of a network (Mildenhall et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Encoding:
    """x and the sines and cosines of its octaves; with no frequencies, x itself."""

    frequencies: int
    include_input: bool
    base_frequency: float
    order: Literal["octave", "axis"]

    @property
    def width(self) -> int:
        return 3 * self.include_input + 6 * self.frequencies

    def encode(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n e"]:
        """The network's input."""
        parts = [points] if self.include_input else []
        if self.frequencies:
            angles = self._angles(points)
            parts.append(self._ordered(torch.sin(angles), torch.cos(angles)))
        return parts[0] if len(parts) == 1 else torch.cat(parts, dim=1)

    def pull_back(self, points: Float[Tensor, "n 3"], gradient: Float[Tensor, "n e"]) -> Float[Tensor, "n 3"]:
        """The gradient with respect to the points, from that with respect to the encoding."""
        if not self.frequencies:
            return gradient
        waves = gradient[:, 3:] if self.include_input else gradient
        angles = self._angles(points)
        by_sine, by_cosine = self._parts(waves)
        slopes = by_sine * torch.cos(angles) - by_cosine * torch.sin(angles)
        pulled = (slopes * self._octaves(points)).sum(dim=2)
        return pulled + gradient[:, :3] if self.include_input else pulled

    def _octaves(self, like: Tensor) -> Float[Tensor, " f"]:
        return self.base_frequency * 2.0 ** torch.arange(self.frequencies, dtype=like.dtype, device=like.device)

    def _angles(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3 f"]:
        return points[:, :, None] * self._octaves(points)

    def _ordered(self, sine: Float[Tensor, "n 3 f"], cosine: Float[Tensor, "n 3 f"]) -> Float[Tensor, "n w"]:
        if self.order == "axis":
            return torch.cat([sine.flatten(1), cosine.flatten(1)], dim=1)
        return torch.stack([sine, cosine], dim=1).permute(0, 3, 1, 2).flatten(1)

    def _parts(self, waves: Float[Tensor, "n w"]) -> tuple[Float[Tensor, "n 3 f"], Float[Tensor, "n 3 f"]]:
        """The sines' and the cosines' part: the inverse of `_ordered`."""
        if self.order == "axis":
            by_kind = waves.unflatten(1, (2, 3, self.frequencies))
        else:
            by_kind = waves.unflatten(1, (self.frequencies, 2, 3)).permute(0, 2, 3, 1)
        return by_kind[:, 0], by_kind[:, 1]
