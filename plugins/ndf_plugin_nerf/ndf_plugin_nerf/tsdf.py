"""Depth maps of virtual cameras all around the object, fused into a truncated signed distance (Sec. 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from ndf_plugin_nerf.lattice import Nodes, Trilinear
from ndf_plugin_nerf.outer_field import OuterField

_CAMERAS = 40
_PIXELS_PER_CELL = 1.6
"""Pixels across a depth map, which covers the box from every side, for each cell along the longest side."""
_FINEST = 128
"""Cells of the fused grid along the longest side, or those of the density's grid where these are fewer."""
_TRUNCATION = 4.0
"""Cells of the fused grid: nodes farther behind a depth say nothing about it."""
_BISECTIONS = 6
_CHUNK = 1 << 19


@dataclass(frozen=True)
class Camera:
    """Parallel rays: looks along the third row of `axes` (right, down, forward) at `middle`, from beyond the box."""

    middle: Float[Tensor, "3"]
    axes: Float[Tensor, "3 3"]
    radius: float
    """Half the width of the picture, and the distance from its plane to the middle."""
    pixels: int
    """Across the picture."""

    def place(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Right, down, and depth behind the plane of the picture."""
        return (points - self.middle) @ self.axes.T + points.new_tensor([0.0, 0.0, self.radius])

    def rays(self) -> Float[Tensor, "p 3"]:
        """Where the ray of each pixel starts."""
        side = self.radius * ((torch.arange(self.pixels, dtype=torch.float64) + 0.5) * (2 / self.pixels) - 1)
        down, right = torch.meshgrid(side, side, indexing="ij")
        flat = torch.stack([right.flatten(), down.flatten(), torch.full((self.pixels**2,), -self.radius)], dim=1)
        return self.middle + flat @ self.axes


def fused(field: OuterField) -> tuple[Nodes, Float[Array, "x y z"]]:
    """Truncated signed distance, positive outside, in units of the truncation; nodes that no camera sees are inside.

    Depths are first crossings of the outer level set, so pits and tunnels that no straight view enters are closed.

    Reference: Curless and Levoy, A volumetric method for building complex models from range images, 1996.
    """
    nodes = Nodes.over(field.nodes.box, min(_FINEST, max(field.nodes.counts) - 1))
    truncation = _TRUNCATION * float(nodes.step.max())
    index = np.stack(np.meshgrid(*(np.arange(n) for n in nodes.counts), indexing="ij"), axis=-1).reshape(-1, 3)
    points = torch.from_numpy(nodes.positions(index))
    total, count = torch.zeros(len(points)), torch.zeros(len(points))
    function = field.function()
    for camera in cameras(nodes):
        depth, last = depth_map(function, camera), camera.pixels - 1
        for start in range(0, len(points), _CHUNK):
            rows = slice(start, start + _CHUNK)
            right, down, behind = camera.place(points[rows]).unbind(1)
            pixel = [((at / camera.radius + 1) * (last / 2 + 0.5)).long().clamp(0, last) for at in (down, right)]
            distance = ((depth[pixel[0], pixel[1]] - behind) / truncation).float()
            seen = distance >= -1.0
            total[rows] += torch.where(seen, distance.clamp_max(1.0), 0.0)
            count[rows] += seen
    values = torch.where(count > 0, total / count.clamp_min(1.0), -1.0)
    return nodes, values.view(nodes.counts).numpy()


def cameras(nodes: Nodes) -> list[Camera]:
    """Cameras spread evenly over a sphere around the box (Fibonacci's spiral), with pixels for these nodes."""
    box, pixels = nodes.box, round(_PIXELS_PER_CELL * (max(nodes.counts) - 1))
    radius = float(np.linalg.norm(box.upper - box.lower)) / 2
    middle = torch.from_numpy((box.lower + box.upper) / 2)
    height = 1 - 2 * (np.arange(_CAMERAS) + 0.5) / _CAMERAS
    turn = np.arange(_CAMERAS) * np.pi * (3 - 5**0.5)
    around = np.sqrt(1 - height**2)
    forward = -np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
    found: list[Camera] = []
    for look in forward:
        right = np.cross(look, np.eye(3)[np.abs(look).argmin()])
        right /= np.linalg.norm(right)
        found.append(Camera(middle, torch.from_numpy(np.stack([right, np.cross(look, right), look])), radius, pixels))
    return found


def depth_map(field: Trilinear, camera: Camera) -> Float[Tensor, "h w"]:
    """Depth of the first point inside on each ray, or infinity. What the box cuts, its sides close."""
    origin, look = camera.rays(), camera.axes[2]
    lower, upper = (torch.from_numpy(corner) for corner in (field.nodes.box.lower, field.nodes.box.upper))
    ends = torch.stack([(lower - origin) / look, (upper - origin) / look])  # infinite along an axis: harmless
    near, far = ends.amin(dim=0).amax(dim=1), ends.amax(dim=0).amin(dim=1)
    depth = torch.full((len(origin),), torch.inf, dtype=torch.float64)
    step = float(field.nodes.step.min())
    rows = (near < far).nonzero()[:, 0]
    at = near[rows]
    while len(rows):
        inside = field(origin[rows] + at[:, None] * look) < 0
        depth[rows[inside]] = at[inside]
        going = ~inside & (at + step < far[rows])
        rows, at = rows[going], at[going] + step
    hit = (depth.isfinite() & (depth > near)).nonzero()[:, 0]
    high = depth[hit]
    low = (high - step).maximum(near[hit])
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        inside = field(origin[hit] + middle[:, None] * look) < 0
        low, high = torch.where(inside, low, middle), torch.where(inside, middle, high)
    depth[hit] = high
    return depth.view(camera.pixels, camera.pixels)
