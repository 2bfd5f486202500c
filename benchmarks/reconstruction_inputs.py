"""The inputs of `reconstruction.py`: clouds and soups of known shapes, real clouds, splats."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from ndf_plugin_gaussians.filtering import filter_splats
from ndf_plugin_gaussians.gaussians import GaussiansConfig
from ndf_plugin_gaussians.readers.splat_file import read_splat_file
from ndf_plugin_pointcloud.point_file import read_point_file
from ndf_plugin_pointcloud.triangles import Triangles
from numpy import ndarray as Array

from ndf_core.readers.mesh_file import read_mesh_file

SHAPES = ("rocker-arm.obj", "fandisk.obj", "armadillo.obj", "oded_scorpion.obj")
"""Smooth with a handle, sharp edges, detail, thin legs."""
CLOUDS = (
    "gpmr_hand.pwn",
    "ipsr_bimba.ply",
    "ipsr_woodfish.ply",
    "wnnc_Armadillo_40000.xyz",
    "wnnc_bunny_noised.xyz",
    "o3d_bunnyData.pts",
)
SPLATS = ("donut_fused.ply", "statue_angel.sog")
POINTS = 20_000
OPAQUE = 0.5
NOISE, TURN = 0.005, np.radians(10)
DELETED, JITTER = 0.1, 1e-3
BOTH = {"ours": {}, "ours --orient": {"orient": True}}


@dataclass(frozen=True)
class Input:
    """What is reconstructed."""

    name: str
    source: Any
    """What `ndf_core.open` takes."""
    representation: str
    points: Float[Array, "n 3"] | None
    """For the others; None where they cannot take it."""
    normals: Float[Array, "n 3"] | None = None
    oriented: bool = True
    """Whether the normals' signs mean something."""
    shape: tuple[Float[Array, "v 3"], Int[Array, "f 3"]] | None = None
    """Where it is known."""
    limit: float | None = None
    """Largest mean distance, both ways, as a share of the size."""
    ours: dict[str, dict[str, Any]] = field(default_factory=lambda: {"ours": {}})
    """Options of the representation by the name of the row."""


def inputs(data: Path) -> Iterator[Input]:
    """Known shapes first."""
    yield from of_shapes(data, SHAPES)
    for name in CLOUDS:
        cloud = read_point_file(data / "pointcloud" / name)
        known = cloud.normals is not None
        representation = "oriented-points" if known else "points"
        ours = {"ours": {}} if known else BOTH
        path = data / "pointcloud" / name
        yield Input(path.stem, path, representation, cloud.points, cloud.normals, known, ours=ours)
    for name in SPLATS:
        path = data / "splat" / name
        splats = filter_splats(read_splat_file(path)[0], GaussiansConfig.model_validate({}), name)[0]
        splats = splats.take(splats.opacities > OPAQUE)
        thinnest = splats.frames()[np.arange(len(splats)), :, splats.scales.argmin(axis=1)]
        yield Input(f"splats {path.stem}", path, "gaussians", splats.centres, thinnest, oriented=False)


def of_shapes(data: Path, names: Iterable[str], seed: int = 0) -> Iterator[Input]:
    """The four inputs of each of some closed meshes."""
    for name in names:
        raw = read_mesh_file(data / "mesh" / name)
        yield from of_shape(Path(name).stem, raw.vertices, raw.faces, seed)


def of_shape(name: str, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], seed: int) -> Iterator[Input]:
    """The four inputs of a closed mesh that have a limit."""
    rng = np.random.default_rng(seed)
    shape, size = (vertices, faces), float(np.ptp(vertices, axis=0).max())
    points, normals, _ = Triangles(vertices, faces.astype(np.int64), ()).sample(POINTS, rng)
    clean = (points, normals)
    yield Input(f"{name} clean", clean, "oriented-points", *clean, shape=shape, limit=1e-3)
    across = np.cross(normals, rng.standard_normal(normals.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    noisy = (
        points + NOISE * size * rng.standard_normal(points.shape),
        np.cos(TURN) * normals + np.sin(TURN) * across,
    )
    yield Input(f"{name} noisy", noisy, "oriented-points", *noisy, shape=shape, limit=3e-3)
    yield Input(f"{name} no normals", points, "points", points, None, False, shape, limit=5e-3, ours=BOTH)
    corners = vertices[faces][rng.random(len(faces)) >= DELETED]
    corners = corners + JITTER * size * rng.uniform(-1, 1, corners.shape)
    soup = (corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    yield Input(f"{name} soup", soup, "soup", None, shape=shape, limit=2e-3)
