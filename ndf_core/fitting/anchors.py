"""Reading anchor pairs (App. D.1) and finding their base points."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.errors import ConfigError
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.losses import Anchors
from ndf_core.fitting.sampling import base_points_at
from ndf_core.kernels.bvh import TriangleBVH

_MOST_BYTES = 10_000_000


def read_anchors(path: Path) -> Float[Array, "m 6"]:
    """Rows px,py,pz,qx,qy,qz of a CSV file, input units; lines that start with # are left out.

    Raises:
        ConfigError: the file cannot be read, is too large, or a line is not six finite numbers.
    """
    try:
        if not path.is_file():
            raise ConfigError(f"anchors {path}: there is no such file")
        if path.stat().st_size > _MOST_BYTES:
            raise ConfigError(f"anchors {path}: larger than {_MOST_BYTES // 10**6} MB; give a few dozen pairs")
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"anchors {path}: cannot be read ({error})") from None
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            row = [float(part) for part in line.split(",")]
        except ValueError:
            row = []
        if len(row) != 6 or not np.isfinite(row).all():
            raise ConfigError(f"anchors {path}, line {number}: need six finite numbers px,py,pz,qx,qy,qz")
        rows.append(row)
    if not rows:
        raise ConfigError(f"anchors {path}: holds no pairs; give lines px,py,pz,qx,qy,qz")
    return np.array(rows)


def anchor_fingerprint(pairs: Float[Array, "m 6"]) -> str:
    """SHA-256 (hex, shortened) of the pairs: what a run is known by, wherever the file lies."""
    return hashlib.sha256(np.ascontiguousarray(pairs, dtype="<f8").tobytes()).hexdigest()[:32]


def place_anchors(
    pairs: Float[Array, "m 6"], geometry: BaseGeometry, center: Float[Array, "3"], scale: float
) -> Anchors:
    """Anchors in the box frame: p goes to the closest base point, q is taken as it is."""
    tree = TriangleBVH(geometry.vertices.double().cpu().numpy(), geometry.faces.cpu().numpy())
    _, faces, barycentric = tree.closest((pairs[:, :3] - center) / scale)
    targets = torch.from_numpy((pairs[:, 3:] - center) / scale).float().to(geometry.device)
    return Anchors(base_points_at(geometry, faces, barycentric), targets)
