"""Opening `soup`: triangles become a winding number, or a shell where that means nothing, and that a surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.spatial import KDTree

from ndf_core.errors import InputError
from ndf_core.interfaces import Surface
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.winding import WindingTree
from ndf_core.readers.mesh_file import read_mesh_file
from ndf_core.readers.polygons import RawMesh
from ndf_core.surfaces.dilation import DilationExtractor, closing_radius, offset_surface
from ndf_core.surfaces.fingerprint import fingerprint
from ndf_plugin_pointcloud.defaults import CLOSEST_DEFAULTS, DILATED_DEFAULTS, HIDDEN_DEFAULTS
from ndf_plugin_pointcloud.directions import Neighbourhood
from ndf_plugin_pointcloud.level_set_mesh import WindingExtractor, sample_by_landing
from ndf_plugin_pointcloud.patches import orient_soup
from ndf_plugin_pointcloud.shell import ClosestTriangles, ShellProjector
from ndf_plugin_pointcloud.soup import SoupConfig
from ndf_plugin_pointcloud.soup_projector import SoupProjector
from ndf_plugin_pointcloud.tracing_projector import TracingProjector
from ndf_plugin_pointcloud.triangles import Triangles, usable_triangles

_SAMPLES = 300_000
"""Points on the triangles: where the level set is looked for, and what is dilated."""
_NEIGHBOURS = 50_000
"""Points on the triangles among which the eight nearest neighbours of the paper are found."""
_RAYS, _LIFT = 20_000, 1e-3
"""Points from which it is looked whether they see the outside, and how far above the triangle, in sizes: above what
sticks out where corners are off a little."""
_ENCLOSING = 0.6
"""Least share of the area seen from outside that the rest has to close up more than not."""
_ACROSS = 1e-4
"""Half of the step across a triangle, in sizes."""
_CLOSED = 0.9
"""Share of the area that bounds the inside, from which landing on the closest triangle is the rule."""
_RADIUS = 0.01
"""Of a dilation, in sizes."""


def open_soup(source: str | Path | object, config: SoupConfig) -> Surface:
    """Open a file of triangles, or a pair of arrays (vertices (v, 3), faces (f, 3)).

    Raises:
        InputError: it cannot be read, or has no triangle with area.
    """
    if isinstance(source, str | Path):
        raw, origin = read_mesh_file(Path(source)), str(source)
    else:
        raw, origin = _from_arrays(source), "the arrays"
    read = usable_triangles(raw, origin)
    digest = fingerprint("soup", config, [read.vertices, read.faces])
    threads = torch.get_num_threads()
    soup, turned = orient_soup(read, threads=threads)
    tree = WindingTree.of_triangles(soup.vertices, soup.faces)
    share = enclosing_share(soup, tree, threads)
    if turned:
        # Loose triangles that stick out may see the outside from behind; all of them as they are may be better.
        as_is = WindingTree.of_triangles(read.vertices, read.faces)
        share_as_is = enclosing_share(read, as_is, threads)
        if share_as_is > share:
            soup, turned, tree, share = read, (), as_is, share_as_is
    notes = [*read.notes, *turned]
    if config.method == "auto":
        if share < _ENCLOSING:
            notes.append(
                f"only {share:.0%} of the area seen from outside is closed up by the rest more than not: taken as a "
                "dilation of the triangles (--method winding caps it instead)"
            )
            return _dilated(soup, config, digest, notes)
    elif config.method == "dilation":
        return _dilated(soup, config, digest, notes)
    return _wound(soup, tree, config, digest, notes)


def enclosing_share(soup: Triangles, tree: WindingTree, threads: int = 1, seed: int = 0) -> float:
    """Share of the area, as the outside sees it from in front, around which the triangles close up more than not.

    Beside a triangle w is s - 1/2 in front and s + 1/2 behind, where the other triangles make s: 1/2 if they close up
    with it, 0 for a flat sheet. Counted is where s > 1/4. Each piece of area counts as much as rays from its front
    escape. Holes that let one see the inside, and triangles that stick out, hardly change it.
    """
    points, normals, _ = soup.sample(_RAYS, np.random.default_rng(seed))
    ball = np.random.default_rng(seed + 1).standard_normal(points.shape)
    ways = normals + ball / np.linalg.norm(ball, axis=1, keepdims=True) * (1 - 1e-6)
    lift = _LIFT * soup.size * normals
    free = TriangleBVH(soup.vertices, soup.faces).first_hit(points + lift, ways, threads)[1] < 0
    both = tree.values(points[free] + lift[free], threads) + tree.values(points[free] - lift[free], threads)
    return float((both / 2 > 0.25).mean()) if free.any() else 1.0


def _wound(soup: Triangles, tree: WindingTree, config: SoupConfig, digest: str, notes: list[str]) -> Surface:
    threads = torch.get_num_threads()
    rng = np.random.default_rng(0)
    area = float(np.linalg.norm(soup.area_vectors, axis=1).sum()) / 2
    near, share = _bounding(soup, tree, rng, threads)
    # As fine as is allowed.
    extractor = WindingExtractor(tree, near, share * area, 0.0, config.resolution, threads)
    points, normals, _ = soup.sample(_NEIGHBOURS, rng)
    radii = np.full(len(points), np.sqrt(area / len(points) / np.pi))
    tracing = TracingProjector(tree, Neighbourhood(KDTree(points), normals, radii), soup.size)
    projector = SoupProjector(soup, tree, tracing)
    return Surface(
        representation="soup",
        base_mesh=extractor,
        projector=projector,
        fingerprint=digest,
        training_defaults=CLOSEST_DEFAULTS if share > _CLOSED else HIDDEN_DEFAULTS,
        sample=lambda count, rng: sample_by_landing(*extractor.dense[:2], projector.land, count, rng),
        notes=tuple(notes),
    )


def _bounding(
    soup: Triangles, tree: WindingTree, rng: np.random.Generator, threads: int
) -> tuple[Float[Array, "n 3"], float]:
    """Points on the triangles across which w - 1/2 changes sign, and their share of the area: what is hidden inside
    need not be looked at.

    Raises:
        InputError: there is none.
    """
    samples, _, face = soup.sample(_SAMPLES, rng)
    points = np.concatenate([samples, soup.vertices[soup.faces].mean(axis=1)])
    vectors = soup.area_vectors[np.concatenate([face, np.arange(len(soup.faces))])]
    lift = _ACROSS * soup.size * vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    crossed = (tree.values(points + lift, threads) > 0.5) != (tree.values(points - lift, threads) > 0.5)
    if not crossed.any():
        raise InputError("the winding number of the triangles is nowhere one half; --method dilation takes any")
    return points[crossed], float(crossed[: len(samples)].mean())


def _dilated(soup: Triangles, config: SoupConfig, digest: str, notes: list[str]) -> Surface:
    """The triangles' offset surface: a shell around sheets, the outer side of what closes up."""
    radius = config.radius or _RADIUS * soup.size
    points = _dense_samples(soup, radius)
    offset = offset_surface(points, radius, config.interior)
    closes = closing_radius(points, radius, radius) is not None
    distance = radius if config.thickness is None else 0.5 * config.thickness
    notes.append(
        f"its surface is at the distance {distance:.4g} from the triangles (--thickness)"
        + (", around what they enclose" if closes and config.interior == "fill" else "")
    )
    projector = ShellProjector(ClosestTriangles(soup.vertices, soup.faces), distance, 3 * radius)
    return Surface(
        representation="soup",
        base_mesh=DilationExtractor(offset),
        projector=projector,
        fingerprint=digest,
        training_defaults=DILATED_DEFAULTS,
        sample=lambda count, rng: sample_by_landing(offset.vertices, offset.faces, projector.land, count, rng),
        notes=tuple(notes),
    )


def _dense_samples(soup: Triangles, radius: float) -> Float[Array, "n 3"]:
    """Points on the triangles that are closer together than the radius, so that their balls make an even surface."""
    area = float(np.linalg.norm(soup.area_vectors, axis=1).sum()) / 2
    count = int(np.clip(16 * area / radius**2, 10_000, 2_000_000))
    return np.concatenate([soup.sample(count, np.random.default_rng(0))[0], soup.vertices[np.unique(soup.faces)]])


def _from_arrays(source: Any) -> RawMesh:
    try:
        vertices, faces = source
        vertices, faces = np.array(vertices, dtype=np.float64), np.array(faces)
    except (TypeError, ValueError) as error:
        raise InputError("soup: need a file, or a pair of arrays (vertices, faces)") from error
    shaped = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3
    if not shaped or faces.dtype.kind not in "iu" or not len(faces):
        raise InputError("soup: need vertices (v, 3) of numbers and faces (f, 3) of integers, at least one")
    return RawMesh(vertices, faces.astype(np.int64))
