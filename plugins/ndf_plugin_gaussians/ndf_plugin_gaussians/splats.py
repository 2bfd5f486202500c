"""Trained 3D Gaussian splats as arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

SH_C0 = 0.28209479177387814
"""Value of the spherical harmonic of degree 0: colour = 1/2 + SH_C0 * coefficient."""


@dataclass(frozen=True)
class Splats:
    """opacity * exp(-|S^-1 R^T (x - centre)|^2 / 2) each, with S = diag(scales) and R from the quaternion.

    float64, in the units and axes of the file.

    Reference: Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023, eq. 4 to 6.
    """

    centres: Float[Array, "n 3"]
    scales: Float[Array, "n 3"]
    """Standard deviations along the axes of the splat; positive or zero."""
    rotations: Float[Array, "n 4"]
    """Unit quaternions (w, x, y, z)."""
    opacities: Float[Array, " n"]
    """Between 0 and 1."""
    colours: Float[Array, "n 3"]
    """Red, green, blue of degree 0; nominally between 0 and 1, not clipped."""

    def __len__(self) -> int:
        return len(self.centres)

    def take(self, rows: Int[Array, " k"] | Bool[Array, " n"]) -> Splats:
        return Splats(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def frames(self) -> Float[Array, "n 3 3"]:
        """Rotation matrices; column k is the axis of scale k."""
        w, x, y, z = self.rotations.T
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


def make_splats(
    centres: Float[Array, "n 3"],
    log_scales: Float[Array, "n 3"],
    quaternions: Float[Array, "n 4"],
    opacities: Float[Array, " n"],
    colours: Float[Array, "n 3"],
) -> tuple[Splats, int]:
    """Splats with unit quaternions, and the number of rows left out because a number in them is not finite.

    A quaternion of length zero counts as no rotation.

    Args:
        centres: any units.
        log_scales: logarithms of the standard deviations.
        quaternions: (w, x, y, z) of any length.
        opacities: between 0 and 1; clipped.
        colours: red, green, blue.
    """
    length = np.linalg.norm(quaternions, axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        scales = np.exp(log_scales)
        good = np.isfinite(centres).all(axis=1) & np.isfinite(scales).all(axis=1) & np.isfinite(length)
        good &= np.isfinite(opacities) & np.isfinite(colours).all(axis=1)
    # Covariances and squared distances must stay finite too.
    good &= (np.abs(centres) < 1e100).all(axis=1) & (scales < 1e100).all(axis=1)
    turned = np.where((length > 0)[:, None], quaternions, [1.0, 0.0, 0.0, 0.0])[good]
    splats = Splats(
        centres=centres[good],
        scales=scales[good],
        rotations=turned / np.where(length > 0, length, 1.0)[good, None],
        opacities=np.clip(opacities[good], 0.0, 1.0),
        colours=colours[good],
    )
    return splats, int(len(good) - good.sum())


def sigmoid(logits: Float[Array, " n"]) -> Float[Array, " n"]:
    """1 / (1 + exp(-x)) without overflow."""
    return 0.5 + 0.5 * np.tanh(0.5 * logits)
