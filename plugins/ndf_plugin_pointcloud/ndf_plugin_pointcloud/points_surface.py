"""Opening `points`: dilated to a closed surface, or given normals and handed on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.interfaces import Surface
from ndf_core.surfaces.dilation import DilationExtractor, closing_radius, eroded, offset_surface, sampling_spacing
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_plugin_pointcloud.areas import disc_areas
from ndf_plugin_pointcloud.defaults import POINTS_DEFAULTS, SHELL_CYCLE, SOLID_CYCLE
from ndf_plugin_pointcloud.level_set_mesh import sample_by_landing
from ndf_plugin_pointcloud.local_planes import LocalDiscs
from ndf_plugin_pointcloud.local_quadrics import LocalQuadrics
from ndf_plugin_pointcloud.neighbours import PLANE_NEIGHBOURS, noise_and_neighbours, quadric_neighbours
from ndf_plugin_pointcloud.orientation import enclosing_share, oriented_normals, outward_vectors
from ndf_plugin_pointcloud.oriented_points import OrientedPointsConfig
from ndf_plugin_pointcloud.oriented_surface import point_array, winding_surface
from ndf_plugin_pointcloud.point_file import PointCloud, point_cloud, read_point_file
from ndf_plugin_pointcloud.points import PointsConfig
from ndf_plugin_pointcloud.shell import ShellProjector

_WIDEST = 0.06
"""Largest radius that is tried, in sizes, or ..."""
_WIDEST_SPACINGS = 3.0
"""... in spacings, where that is more."""
_EROSION = 0.7
"""Of a solid's dilation, in radii: its base mesh then begins near the points, and still closes their gaps."""
_WIDE = 2.5
"""Balls of more spacings, where gaps need them, fill what lies apart too. Ordinary clouds close at 1.2 to 2."""
_ENCLOSING = 0.6
"""Least share of the points that close up. Thin solids and scans with holes had 0.8 and more, sheets up to 0.1."""
_SHELL_NEIGHBOURS = 40
"""Most points of a shell's planes, however noisy: more take too long."""
_THIN, _SCATTERED = 0.5, 0.25
"""Distance of a thin shell from its points, in spacings; their scatter instead where it is more than the latter:
points on both sides of a plate scatter by half of its thickness."""
_STEADY = 0.8
"""Least share of a sheet that is found again from its dilation. Scans had 0.91 and more, few or sparse points up to
0.65."""
_FLAT = 0.7
"""Least ratio of a disc's half axes, in the median. Sheets had 0.86 and more, curves up to 0.52."""
_ASKED = 5000
"""Points that this is measured at."""
_LIMIT = 3.0
"""Queries farther than so many radii from all points are over a gap."""


def open_points(source: str | Path | object, config: PointsConfig) -> Surface:
    """Open a file of points, or an array of them (n, 3). Normals in the file are not used.

    Raises:
        InputError: it cannot be read.
    """
    if isinstance(source, str | Path):
        cloud = read_point_file(Path(source))
    else:
        cloud = point_cloud(point_array(source, "points"), None, "the array")
    notes = list(cloud.notes)
    if cloud.normals is not None:
        notes.append("its normals are not used; --repr oriented-points uses them")
    points, threads = cloud.points, torch.get_num_threads()
    digest = fingerprint("points", config, [points])
    spacing = float(np.median(sampling_spacing(points)))
    widest = max(_WIDEST * cloud.size, _WIDEST_SPACINGS * spacing)
    if config.radius is None:
        closing = closing_radius(points, spacing, widest)
        radius = closing or 2 * spacing
    else:
        radius = config.radius
        closing = closing_radius(points, radius, radius)
    if closing is None:
        notes.append(
            f"the points close around nothing at radii up to {config.radius or widest:.4g}: a sheet, or wide gaps"
        )
    noise, wanted = noise_and_neighbours(points, threads)
    if wanted > PLANE_NEIGHBOURS:
        notes.append(f"the points have noise of about {noise:.2g} along the normals (standard deviation)")
    wide = closing is None or closing > _WIDE * spacing
    if config.orient or (wide and config.open != "shell"):
        outwards = None if closing is None else outward_vectors(points, offset_surface(points, radius), threads)
        count = config.neighbours or max(PLANE_NEIGHBOURS, round(wanted))
        normals = oriented_normals(points, count, outwards, threads)
        capped = config.orient or (closing is None and config.open == "cap")
        if capped or _is_solid(points, normals, config, threads):
            notes.append("normals estimated; the surface is where their winding number is one half, which caps gaps")
            oriented = PointCloud(points, normals, tuple(notes))
            # Estimated normals of thin parts and rims may face anywhere, and cells are smallest there.
            return winding_surface(
                oriented, OrientedPointsConfig.model_validate({}), "points", digest, point_areas=disc_areas
            )
    offset = offset_surface(points, radius, config.interior)
    solid, distance = closing is not None and config.interior == "fill", 0.0
    if solid:
        count = config.neighbours or quadric_neighbours(wanted)
        search = LocalQuadrics(points, count, outward_vectors(points, offset, threads), threads)
        notes.append(f"dilated by {radius:.4g} and filled; the surface is fitted to {count} points around each")
    else:
        count = round(float(np.clip(wanted, PLANE_NEIGHBOURS, _SHELL_NEIGHBOURS)))
        search = LocalDiscs(points, config.neighbours or count, threads)
        distance = (
            0.5 * config.thickness
            if config.thickness
            else _shell_distance(points, search, spacing, noise, radius, threads)
        )
        notes.append(
            f"the surface is a closed shell at the distance {distance:.4g} around the points (--thickness)"
            + ("" if closing else "; --open cap makes a capped solid of them instead")
        )
    projector = ShellProjector(search, distance, _LIMIT * radius)
    weights, length = (SOLID_CYCLE, radius) if solid else (SHELL_CYCLE, spacing)
    cycle = next(weight for bound, weight in weights if length < bound * cloud.size)
    return Surface(
        representation="points",
        base_mesh=DilationExtractor(eroded(offset, _EROSION * radius, threads) if solid else offset),
        projector=projector,
        fingerprint=digest,
        training_defaults={**POINTS_DEFAULTS, "loss": {**POINTS_DEFAULTS["loss"], "cycle": cycle}},
        sample=lambda count, rng: (
            # Each point moved onto the surface: it may be off by its noise.
            (projector.land(rng.choice(points, count)).points, None)
            if solid
            else sample_by_landing(offset.vertices, offset.faces, projector.land, count, rng)
        ),
        notes=tuple(notes),
    )


def _shell_distance(
    points: Float[Array, "n 3"], search: LocalDiscs, spacing: float, noise: float, radius: float, threads: int
) -> float:
    """How far a shell's two sides stay from its middle, input units.

    Near, if the points lie on a sheet that is steady: seen from the dilation, on either side, it is where it was.
    Where they have no one sheet (they lie along curves, or are too few to tell) the sides would get into each other's
    way, and stay where the dilation is.
    """
    rows = np.linspace(0, len(points) - 1, min(len(points), _ASKED)).astype(np.int64)
    middle = search(points[rows], threads)
    seen = [search(middle.points + side * radius * middle.normals, threads).points for side in (-1.0, 1.0)]
    moved = np.linalg.norm(np.stack(seen) - middle.points, axis=2)
    if search.flatness < _FLAT or (moved < _THIN * spacing).mean() < _STEADY:
        return radius
    return min(noise if noise > _SCATTERED * spacing else _THIN * spacing, radius)


def _is_solid(points: Float[Array, "n 3"], normals: Float[Array, "n 3"], config: PointsConfig, threads: int) -> bool:
    """Whether points that no close dilation closes have an inside; not where a dilation is asked for."""
    if config.radius is not None or config.interior == "keep":
        return False
    return enclosing_share(points, normals, threads) > _ENCLOSING
