"""Networks written with torch's own modules, as references for what the plugin computes."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn


def encoded(points: Tensor, octaves: int) -> Tensor:
    """NeRF's and NeuS's embedder: x, sin x, cos x, sin 2x, cos 2x, ..."""
    parts = [points]
    for k in range(octaves):
        parts += [torch.sin(2.0**k * points), torch.cos(2.0**k * points)]
    return torch.cat(parts, dim=1)


class NeusSdf(nn.Module):
    """NeuS's SDFNetwork (models/fields.py): weight norm, geometric initialisation, a skip at the fourth layer."""

    def __init__(self, width: int = 64, octaves: int = 6, outputs: int = 17, scale: float = 1.5) -> None:
        super().__init__()
        self.octaves, self.scale = octaves, scale
        entry = 3 + 6 * octaves
        dims = [entry] + [width] * 8 + [outputs]
        for layer in range(9):
            out = dims[layer + 1] - entry if layer + 1 == 4 else dims[layer + 1]
            linear = nn.Linear(dims[layer], out)
            if layer == 8:
                nn.init.normal_(linear.weight, math.sqrt(math.pi) / math.sqrt(dims[layer]), 1e-4)
                nn.init.constant_(linear.bias, -0.6)
            else:
                nn.init.constant_(linear.bias, 0.0)
                nn.init.normal_(linear.weight, 0.0, math.sqrt(2) / math.sqrt(out))
                if layer == 0:
                    nn.init.constant_(linear.weight[:, 3:], 0.0)
                if layer == 4:
                    nn.init.constant_(linear.weight[:, -(entry - 3) :], 0.0)
            setattr(self, f"lin{layer}", nn.utils.weight_norm(linear))
        self.activation = nn.Softplus(beta=100)

    def forward(self, points: Tensor) -> Tensor:
        entry = encoded(points * self.scale, self.octaves)
        hidden = entry
        for layer in range(9):
            if layer == 4:
                hidden = torch.cat([hidden, entry], dim=1) / math.sqrt(2)
            hidden = getattr(self, f"lin{layer}")(hidden)
            if layer < 8:
                hidden = self.activation(hidden)
        return hidden[:, 0] / self.scale


class Ball(nn.Module):
    """|x| - 0.6, nearly: the mean of x's positive parts along directions that cover the sphere evenly."""

    def __init__(self, hidden: int = 60) -> None:
        super().__init__()
        height = (2 * torch.arange(hidden) + 1) / hidden - 1
        angle = math.pi * (1 + math.sqrt(5)) * torch.arange(hidden)  # Fibonacci's spiral
        ring = (1 - height**2).sqrt()
        normals = torch.stack([ring * angle.cos(), ring * angle.sin(), height], dim=1)
        first, second = nn.Linear(3, hidden), nn.Linear(hidden, 1)
        with torch.no_grad():
            first.weight.copy_(normals)
            first.bias.zero_()
            # The mean of the positive parts over all directions is a quarter of the length.
            second.weight.fill_(4.0 / hidden)
            second.bias.fill_(-0.6)
        self.layers = nn.Sequential(first, nn.ReLU(), second)

    def forward(self, points: Tensor) -> Tensor:
        return self.layers(points)[:, 0]
