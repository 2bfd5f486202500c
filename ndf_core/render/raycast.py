"""Pictures of triangle meshes by ray casting: no GPU, no display, no dependency beyond numpy and our BVH."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped, UInt8
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.render.camera import Camera, View
from ndf_core.render.shading import CLAY, clay_light, corner_normals, to_linear, to_srgb

WHITE = (1.0, 1.0, 1.0)
_INSIDE = np.array([0.62, 0.42, 0.36])
"""Linear factor on the back of faces, so that holes and inverted faces show."""
_PAINT_SHADE = 0.6
"""How much of the light's variation reaches given colours: they must stay comparable with a colour bar."""
_LINE = np.array([0.012, 0.016, 0.024])
_LINE_WIDTH = 1.1
_LINE_STRENGTH = 0.62

# Rotated grid: four samples whose columns and rows all differ, better for near-vertical and near-horizontal edges.
_SAMPLES = ((-0.125, -0.375), (0.375, -0.125), (-0.375, 0.125), (0.125, 0.375))


def render_mesh(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    *,
    width: int = 800,
    height: int = 800,
    view: View | Camera = (30.0, 20.0),
    bounds: Float[Array, "n 3"] | None = None,
    up: Literal["y", "z"] = "y",
    colors: Shaped[Array, "n 3"] | None = None,
    wireframe: bool = False,
    crease: float | int = 40.0,
    background: tuple[float, float, float] = WHITE,
    antialias: bool = True,
    threads: int = 1,
) -> UInt8[Array, "h w 3"]:
    """Picture of a mesh as soft clay, or in the given colours, under studio light.

    The same arguments give the same picture, byte for byte, for any number of threads.

    Args:
        vertices: float64, any units.
        faces: counter-clockwise seen from outside; the inside is shown in a reddish tone.
        width: pixels.
        height: pixels.
        view: azimuth and elevation in degrees, framing `bounds`; or a camera.
        bounds: points to be framed, the mesh's own vertices by default. Give all pictures of one shape the same.
        up: the axis that points up.
        colors: sRGB per vertex or per face (per vertex where there are as many), uint8 or float in [0, 1].
        wireframe: draw the edges, thin and antialiased; they fade where faces are smaller than a few pixels.
        crease: edges that bend by more degrees are shaded sharp; 0 shows every face flat.
        background: sRGB in [0, 1].
        antialias: take four samples in every pixel where the picture is not smooth.
        threads: rays are shared out over this many threads.

    Raises:
        ValueError: the mesh has no face or is not finite, or the colours fit neither faces nor vertices.
    """
    if width < 1 or height < 1:
        raise ValueError(f"picture: need a positive size, got {width} x {height}")
    tree = TriangleBVH(vertices, faces)
    if not isinstance(view, Camera):
        used = vertices[np.unique(faces)] if bounds is None else bounds
        view = Camera.framing(used, view, aspect=width / height, up=up)
    scene = _Scene(
        tree=tree,
        camera=view,
        vertices=vertices,
        faces=faces,
        normals=corner_normals(vertices, faces, crease) @ view.axes.T,
        colors=_linear_colors(colors, len(vertices), len(faces)),
        painted=colors is not None,
        background=to_linear(np.array(background, dtype=np.float64)),
        wireframe=wireframe,
        size=(width, height),
        threads=threads,
    )
    row, column = np.divmod(np.arange(width * height), width)
    light, face, depth = scene.trace(column + 0.5, row + 0.5)
    if antialias:
        rough = np.flatnonzero(_rough(light, face, depth, scene))
        samples = [scene.trace(column[rough] + 0.5 + x, row[rough] + 0.5 + y)[0] for x, y in _SAMPLES]
        light[rough] = np.clip(samples, 0, 1).mean(axis=0)  # clipped first: a highlight must not outshine its pixel
    return np.round(to_srgb(light) * 255).astype(np.uint8).reshape(height, width, 3)


@dataclass(frozen=True)
class _Scene:
    tree: TriangleBVH
    camera: Camera
    vertices: Float[Array, "v 3"]
    faces: Int[Array, "f 3"]
    normals: Float[Array, "f 3 3"]
    """Per corner, in the camera's frame."""
    colors: Float[Array, "n 3"]
    """Linear; per vertex, per face, or one for all."""
    painted: bool
    background: Float[Array, "3"]
    wireframe: bool
    size: tuple[int, int]
    threads: int

    def trace(
        self, columns: Float[Array, " n"], rows: Float[Array, " n"]
    ) -> tuple[Float[Array, "n 3"], Int[Array, " n"], Float[Array, " n"]]:
        """Linear light, face (-1 for none) and depth (inf for none) at picture positions in pixels."""
        origins, directions = self.camera.rays(columns, rows, *self.size)
        depth, face = self.tree.first_hit(origins, directions, threads=self.threads)
        hit = np.flatnonzero(face >= 0)
        light = np.broadcast_to(self.background, (len(face), 3)).copy()
        seen = face[hit]
        points = origins[hit] + depth[hit, None] * directions[hit]
        weights = _barycentric(points, self.vertices, self.faces[seen])
        light[hit] = self._shade(seen, weights, directions[hit])
        if self.wireframe and len(hit):
            ink = self._ink(seen, columns[hit], rows[hit])[:, None]
            light[hit] = light[hit] * (1 - ink) + _LINE * ink
        return light, face, depth

    def _shade(
        self, seen: Int[Array, " m"], weights: Float[Array, "m 3"], directions: Float[Array, "m 3"]
    ) -> Float[Array, "m 3"]:
        normals = np.einsum("mi,mik->mk", weights, self.normals[seen])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        corners = self.vertices[self.faces[seen]]
        outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        back = np.einsum("mk,mk->m", outward, directions) > 0
        normals[back] *= -1
        if len(self.colors) == len(self.vertices):
            albedo = np.einsum("mi,mik->mk", weights, self.colors[self.faces[seen]])
        else:
            albedo = self.colors[seen] if len(self.colors) == len(self.faces) else self.colors
        light, highlight = clay_light(normals)
        if self.painted:
            light = _PAINT_SHADE * light + (1 - _PAINT_SHADE)
            highlight = _PAINT_SHADE * highlight
        light = light * albedo
        light[back] *= _INSIDE
        return light + highlight[:, None]

    def _ink(
        self, seen: Int[Array, " m"], columns: Float[Array, " m"], rows: Float[Array, " m"]
    ) -> Float[Array, " m"]:
        """How much of the line colour covers each pixel, from its distance in pixels to the edges of its face."""
        corners = self.camera.project(self.vertices, *self.size)[self.faces[seen]]
        start, along = corners, np.roll(corners, -1, axis=1) - corners
        length = np.maximum(np.linalg.norm(along, axis=2), 1e-9)
        offset = np.stack([columns, rows], axis=1)[:, None] - start
        distance = np.abs(along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0]) / length
        doubled_area = np.abs(along[:, 0, 0] * along[:, 1, 1] - along[:, 0, 1] * along[:, 1, 0])
        thickness = doubled_area / length.max(axis=1)
        fade = np.clip((thickness - 1.5) / 5.0, 0.0, 1.0)
        return _LINE_STRENGTH * fade * np.clip(_LINE_WIDTH / 2 + 0.5 - distance.min(axis=1), 0.0, 1.0)


def _rough(
    light: Float[Array, "n 3"], face: Int[Array, " n"], depth: Float[Array, " n"], scene: _Scene
) -> Bool[Array, " n"]:
    """Pixels beside an outline, a step in depth, or a sudden change of light."""
    width, height = scene.size
    hit = (face >= 0).reshape(height, width)
    tone = to_srgb(light).mean(axis=1).reshape(height, width)
    inverse = np.where(hit, 1 / np.where(hit, depth.reshape(height, width), 1), 0)
    rough = np.zeros((height, width), bool)
    for axis in (0, 1):
        here = [slice(None)] * 2
        there = [slice(None)] * 2
        here[axis], there[axis] = slice(None, -1), slice(1, None)
        one, two = tuple(here), tuple(there)
        step = (hit[one] != hit[two]) | (np.abs(tone[one] - tone[two]) > 0.04)
        step |= np.abs(inverse[one] - inverse[two]) > 0.02 * np.maximum(inverse[one], inverse[two])
        rough[one] |= step
        rough[two] |= step
    return rough.ravel()


def _barycentric(
    points: Float[Array, "m 3"], vertices: Float[Array, "v 3"], faces: Int[Array, "m 3"]
) -> Float[Array, "m 3"]:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    ab, ac, ap = b - a, c - a, points - a
    normal = np.cross(ab, ac)
    area = np.maximum(np.einsum("mk,mk->m", normal, normal), 1e-300)
    v = np.einsum("mk,mk->m", np.cross(ap, ac), normal) / area
    w = np.einsum("mk,mk->m", np.cross(ab, ap), normal) / area
    weights = np.clip(np.stack([1 - v - w, v, w], axis=1), 0, 1)
    return weights / weights.sum(axis=1, keepdims=True)


def _linear_colors(colors: Shaped[Array, "n 3"] | None, vertices: int, faces: int) -> Float[Array, "n 3"]:
    if colors is None:
        return to_linear(np.array([CLAY]))
    if colors.ndim != 2 or colors.shape[1] != 3 or len(colors) not in (vertices, faces):
        raise ValueError(f"colors: need one RGB row per vertex ({vertices}) or face ({faces}), got {colors.shape}")
    return to_linear(colors.astype(np.float64) / 255 if colors.dtype == np.uint8 else np.clip(colors, 0.0, 1.0))
