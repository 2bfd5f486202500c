"""Opening `oriented-points`: points with normals become a winding number, and that a surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.kernels.winding import WindingTree
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_plugin_pointcloud.areas import PointAreas, cell_areas
from ndf_plugin_pointcloud.defaults import CLEAN_DEFAULTS, WINDING_DEFAULTS
from ndf_plugin_pointcloud.denoising import OrientedPoints, without_noise
from ndf_plugin_pointcloud.directions import Neighbourhood
from ndf_plugin_pointcloud.level_set_mesh import WindingExtractor, sample_by_landing
from ndf_plugin_pointcloud.noise import is_clean, noise_level, smoothing_for
from ndf_plugin_pointcloud.oriented_points import OrientedPointsConfig
from ndf_plugin_pointcloud.point_file import PointCloud, point_cloud, read_point_file
from ndf_plugin_pointcloud.spatial_order import spatial_order
from ndf_plugin_pointcloud.tracing_projector import TracingProjector

_CELLS = 0.8
"""Size of a cell in radii of the disc that a point stands for: about half the distance between points."""


def open_oriented_points(source: str | Path | object, config: OrientedPointsConfig) -> Surface:
    """Open a file of points with normals, or a pair of arrays (points (n, 3), normals (n, 3)).

    Raises:
        InputError: it cannot be read, or has no normals.
    """
    cloud = read_point_file(Path(source)) if isinstance(source, str | Path) else _from_arrays(source)
    if cloud.normals is None:
        raise InputError(f"{source}: has no normals; read it with --repr points, with --orient to estimate them")
    digest = fingerprint("oriented-points", config, [cloud.points, cloud.normals])
    return winding_surface(cloud, config, "oriented-points", digest)


def winding_surface(
    cloud: PointCloud,
    config: OrientedPointsConfig,
    representation: str,
    digest: str,
    point_areas: PointAreas = cell_areas,
) -> Surface:
    """The surface w = 1/2 of points with normals.

    Args:
        cloud: with normals.
        config: smoothing and resolution.
        representation: the `--repr` name.
        digest: the input's fingerprint.
        point_areas: how much surface each point stands for.
    """
    assert cloud.normals is not None
    threads = torch.get_num_threads()
    notes, order = list(cloud.notes), spatial_order(cloud.points)
    points, normals = cloud.points[order], cloud.normals[order]
    tree = KDTree(points)
    areas = point_areas(tree, normals, threads)
    # Three times the volume, by the divergence theorem.
    if np.einsum("n,nc,nc->", areas, normals, points - points.mean(axis=0)) < 0:
        normals = -normals
        notes.append("the normals point inwards; all of them turned over")
    given = OrientedPoints(tree, normals, areas)
    noise = noise_level(tree, normals, given.radii, threads)
    clean = is_clean(noise)
    if config.denoise and not clean:
        smooth = without_noise(given, point_areas, threads)
        if smooth is not given:
            notes.append("neighbours scatter; points moved onto quadrics through those that face the same way")
        tree, normals, areas = smooth
        noise = noise_level(tree, normals, smooth.radii, threads)
    points, radii = np.asarray(tree.data), np.sqrt(areas / np.pi)
    smoothing = config.smoothing or smoothing_for(noise)
    winding = WindingTree.of_points(points, areas[:, None] * normals, smoothing * radii)
    cell = _CELLS * float(np.median(radii))
    extractor = WindingExtractor(winding, points, float(areas.sum()), cell, config.resolution, threads)
    projector = TracingProjector(winding, Neighbourhood(tree, normals, radii), cloud.size)
    return Surface(
        representation=representation,
        base_mesh=extractor,
        projector=projector,
        fingerprint=digest,
        training_defaults=CLEAN_DEFAULTS if clean else WINDING_DEFAULTS,
        sample=lambda count, rng: sample_by_landing(*extractor.dense[:2], projector.land, count, rng),
        notes=tuple(notes),
    )


def _from_arrays(source: Any) -> PointCloud:
    try:
        points, normals = source
        points, normals = np.array(points, dtype=np.float64), np.array(normals, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("oriented-points: need a file, or a pair of arrays (points, normals)") from error
    if points.ndim != 2 or points.shape[1] != 3 or normals.shape != points.shape:
        raise InputError("oriented-points: need points (n, 3) and normals (n, 3)")
    return point_cloud(points, normals, "the arrays")


def point_array(source: Any, what: str) -> Array:
    """An array of points (n, 3).

    Raises:
        InputError: it is none.
    """
    try:
        points = np.array(source, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: need a file, or an array of points (n, 3)") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{what}: need points (n, 3), got an array of shape {points.shape}")
    return points
