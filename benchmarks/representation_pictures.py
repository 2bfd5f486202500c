"""Pictures of an input beside the mesh extracted from its asset, the input shown as what it is.

Points and centres of splats are drawn as squares, triangles as they are, and level sets as samples of
the surface that no mesh stands between (grids, networks, functions).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray as Array

import ndf_core
from ndf_core.readers.mesh_file import read_mesh_file
from ndf_core.render.camera import Camera
from ndf_core.render.panels import panels
from ndf_core.render.raycast import render_mesh
from ndf_core.render.shading import CLAY, clay_light, to_linear, to_srgb

WIDTH, HEIGHT = 460, 460
VIEWS = ((30.0, 15.0), (205.0, -20.0))
OPAQUE = 0.5
SAMPLES = 150_000
Triangles = tuple[Float[Array, "v 3"], Int[Array, "f 3"]]


class Dots(NamedTuple):
    """Points to be painted, with colours (sRGB in [0, 1]) or normals to shade by."""

    points: Float[Array, "n 3"]
    colours: Float[Array, "n 3"] | None
    normals: Float[Array, "n 3"] | None
    what: str
    closed: bool = False
    """Whether what faces away is hidden by something in front."""


def picture(path: Path, representation: str, options: dict[str, Any], mesh: Triangles) -> UInt8[Array, "h w 3"]:
    """Input, opened with these options, and mesh from two sides."""
    # Splats mostly have y pointing down, scanners, cameras of NeRFs and volumes z pointing up.
    turn = np.diag([1.0, -1.0, -1.0]) if representation == "gaussians" else np.eye(3)
    up = "z" if representation in ("nerf", "grid") else "y"
    vertices, faces = mesh[0] @ turn, mesh[1]
    source = input_of(path, representation, options)
    images: list[UInt8[Array, "h w 3"]] = []
    for view in VIEWS:
        camera = Camera.framing(vertices, view, aspect=WIDTH / HEIGHT, up=up)
        if isinstance(source, Dots):
            images.append(paint(source._replace(points=source.points @ turn), camera))
        else:
            images.append(render_mesh(*source, width=WIDTH, height=HEIGHT, view=camera))
        images.append(render_mesh(vertices, faces, width=WIDTH, height=HEIGHT, view=camera))
    what = source.what if isinstance(source, Dots) else f"{len(source[1]):,} triangles"
    titles = [f"{path.name}: {what}", f"{representation}: {len(faces):,} faces", "", ""]
    return panels(images, titles, columns=4)


def input_of(path: Path, representation: str, options: dict[str, Any]) -> Dots | Triangles:
    """What is to be seen of the input."""
    if representation in ("soup", "mesh"):
        raw = read_mesh_file(path)
        return raw.vertices, raw.faces.astype(np.int32)
    if representation in ("points", "oriented-points"):
        from ndf_plugin_pointcloud.point_file import read_point_file

        cloud = read_point_file(path)
        return Dots(cloud.points, None, cloud.normals, f"{len(cloud.points):,} points")
    if representation == "gaussians":
        from ndf_plugin_gaussians.readers.splat_file import read_splat_file

        splats = read_splat_file(path)[0]
        shown = splats.take(splats.opacities > OPAQUE)
        return Dots(shown.centres, shown.colours, None, f"{len(shown):,} opaque centres")
    surface = ndf_core.open(path, repr=representation, **options)
    assert surface.sample is not None, f"{representation} has no samples to show"
    points, normals = surface.sample(SAMPLES, np.random.default_rng(0))
    return Dots(points, None, normals, "samples of the level set", closed=True)


def paint(dots: Dots, camera: Camera) -> UInt8[Array, "h w 3"]:
    """Squares, near ones over far ones; without colours clay under studio light, or darker with depth."""
    if dots.closed and dots.normals is not None:
        facing = ((camera.eye - dots.points) * dots.normals).sum(axis=1) > 0
        dots = dots._replace(points=dots.points[facing], normals=dots.normals[facing])
    place = (dots.points - camera.eye) @ camera.axes.T
    if dots.colours is not None:
        colours = dots.colours
    elif dots.normals is not None:
        light, highlight = clay_light(dots.normals @ camera.axes.T)
        clay = to_linear(np.array([CLAY]))
        colours = to_srgb(light * clay + highlight[:, None])
    else:
        depth = (place[:, 2] - place[:, 2].min()) / max(float(np.ptp(place[:, 2])), 1e-300)
        colours = np.repeat(0.75 - 0.6 * depth[:, None], 3, axis=1)
    order = np.argsort(place[:, 2])
    pixel = np.floor(camera.project(dots.points[order], WIDTH, HEIGHT)).astype(np.int64)
    reach = 0 if len(dots.points) > 400_000 else 1
    inside = ((pixel >= reach) & (pixel < np.array([WIDTH, HEIGHT]) - reach)).all(axis=1)
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2), axis=-1).reshape(-1, 2)
    rows = (pixel[inside][:, None] + offsets).reshape(-1, 2)
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    paints = np.round(np.clip(colours[order][inside], 0, 1) * 255).astype(np.uint8)
    image[rows[:, 1], rows[:, 0]] = np.repeat(paints, len(offsets), axis=0)
    return image
