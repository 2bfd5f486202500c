"""Is the mesh of a file of splats an outer surface, and does it go through the splats?

For every file: opens it as `gaussians`, fits 4,000 base faces (or takes the asset that `representations.py` made),
extracts, and measures

- `distance`: median distance from the opaque centres (opacity > 0.5) that the filter keeps to the mesh;
- `residual`: median distance of the same centres from the plane through their 25 nearest; `ratio` is distance over
  residual, lengths are shares of the longest side;
- `ratio_seen`: the same for the centres that are seen: from some of 26 directions at least half of the light gets
  past the splats in front of them. Splats inside of an object belong to no outer surface;
- `solid`: share of 2,000 rays from outside that find solid (winding number of the mesh above 1/2) 2% of the longest
  side behind their first hit; and what the others met: `thin` (the mesh itself is thinner than that below the hit),
  `pit` (the ray enters again within 2%), `ridge` (the rest: edges and grazing rays);
- `color_error`, with `--colors`: mean over channels and opaque centres of the colour learned (`ndf fit --colors`) at
  the closest point less the splat's own, and the bytes it adds.

    python benchmarks/splats.py [FILE ...] [--steps N] [--option base_mesh=dilation ...] [--assets FOLDER]
        [--pictures FOLDER] [--colors]
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import igl
import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from ndf_plugin_gaussians.filtering import filter_splats
from ndf_plugin_gaussians.gaussians import GaussiansConfig
from ndf_plugin_gaussians.readers.splat_file import read_splat_file
from ndf_plugin_gaussians.splats import Splats
from ndf_plugin_gaussians.surfels import cut
from numpy import ndarray as Array
from scipy.spatial import cKDTree

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.fitting.colors import learn_colors
from ndf_core.interfaces import ColoredPoints
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals
from ndf_core.render.camera import Camera
from ndf_core.render.panels import panels
from ndf_core.render.png import write_png
from ndf_core.render.raycast import render_mesh

HERE = Path(__file__).resolve().parent
OPAQUE = 0.5
NEIGHBOURS = 25
RAYS = 2000
BEHIND = 0.02
RASTER = 150
WIDTH, HEIGHT = 420, 600


@dataclass(frozen=True)
class Row:
    """One file."""

    file: str
    options: dict[str, str]
    splats: int
    kept: int
    distance: float
    residual: float
    ratio: float
    seen: float
    """Share of the opaque centres."""
    ratio_seen: float
    solid: float
    thin: float
    pit: float
    ridge: float
    """Shares of all rays."""
    closed: bool
    manifold: bool
    components: int
    genus: int
    folded_area: float
    converged: float
    seconds_open: float | None
    """None where the asset was there; `results/representations.json` has the seconds of all of it then."""
    seconds_fit: float | None
    asset_bytes: int
    notes: tuple[str, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--data", type=Path, default=HERE.parent.parent / "shared" / "data" / "splat")
    parser.add_argument("--steps", type=int, help="of the fit; none: as by default")
    parser.add_argument("--faces", type=int, default=4000)
    parser.add_argument("--option", action="append", default=[], metavar="NAME=VALUE", help="of the representation")
    parser.add_argument(
        "--assets",
        type=Path,
        help="folder with assets of representations.py; where one is missing it is fitted and written",
    )
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--colors", action="store_true", help="learn and measure colours too")
    parser.add_argument("--output", type=Path, default=HERE / "results" / "splats.json")
    arguments = parser.parse_args()
    options = dict(text.split("=", 1) for text in arguments.option)
    done = json.loads(arguments.output.read_text()) if arguments.output.exists() else []
    for path in arguments.files or sorted(arguments.data.iterdir()):
        fitted = arguments.assets and arguments.assets / f"splat_{path.name}.ndf"
        if fitted and fitted.is_file():
            asset, seconds, notes = ndf_core.load(fitted), (None, None), ()
        else:
            asset, seconds, notes = fit(path, options, arguments.faces, arguments.steps)
            if fitted:
                asset.save(fitted)
        row = asdict(measure_file(path, options, asset, seconds, notes, arguments.pictures))
        row |= (
            measure_colors(path, options, asset) if arguments.colors else {"color_error": None, "color_bytes": None}
        )
        same = [r for r in done if (r["file"], r["options"]) == (row["file"], row["options"])]
        done = [r for r in done if r not in same] + [row]
        print(" ".join(f"{key}={value:.4g}" if isinstance(value, float) else f"{key}={value}"
                       for key, value in row.items() if key != "notes"), flush=True)  # fmt: skip
        arguments.output.parent.mkdir(exist_ok=True)
        arguments.output.write_text(json.dumps(sorted(done, key=lambda r: (r["file"], str(r["options"]))), indent=1))


Seconds = tuple[float | None, float | None]


def fit(path: Path, options: dict[str, str], faces: int, steps: int | None) -> tuple[Asset, Seconds, tuple[str, ...]]:
    """The asset, CPU seconds of opening and fitting, and what was said about the file."""
    torch.set_num_threads(1)
    start = time.process_time()
    surface = ndf_core.open(path, repr="gaussians", **options)
    opened = time.process_time()
    asset = ndf_core.fit(surface, faces=faces, threads=1, **({"steps": steps} if steps else {}))
    return asset, (round(opened - start, 1), round(time.process_time() - opened, 1)), surface.notes


def measure_file(
    path: Path, options: dict[str, str], asset: Asset, seconds: Seconds, notes: tuple[str, ...], pictures: Path | None
) -> Row:
    """Extract and measure one file."""
    mesh = asset.extract()
    splats = read_splat_file(path)[0]
    kept = filter_splats(splats, GaussiansConfig.model_validate(options), str(path))[0]
    size = float(np.ptp(mesh.vertices, axis=0).max())
    opaque = kept.take(kept.opacities > OPAQUE)
    centres = opaque.centres
    far, residuals = distances(mesh.vertices, mesh.faces, centres) / size, plane_residuals(centres) / size
    distance, residual = float(np.median(far)), float(np.median(residuals))
    outer = seen(kept, centres)
    counts = mesh_counts(mesh.faces, len(mesh.vertices))
    rays = ray_shares(mesh.vertices, mesh.faces)
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
        write_png(pictures / f"{path.name}.png", picture(kept, mesh.vertices, mesh.faces, path.name))
    return Row(
        file=path.name,
        options=options,
        splats=len(splats),
        kept=len(kept),
        distance=distance,
        residual=residual,
        ratio=distance / residual,
        seen=float(outer.mean()),
        ratio_seen=float(np.median(far[outer]) / np.median(residuals[outer])),
        solid=rays[0],
        thin=rays[1],
        pit=rays[2],
        ridge=rays[3],
        closed=bool(mesh.statistics["closed"]),
        manifold=bool(mesh.statistics["manifold"]),
        components=counts[0],
        genus=counts[1],
        folded_area=float(mesh.statistics["folded_area"]),
        converged=float(asset.content.provenance["error"]["converged"]),
        seconds_open=seconds[0],
        seconds_fit=seconds[1],
        asset_bytes=asset.size,
        notes=notes,
    )


def distances(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], points: Float[Array, "n 3"]
) -> Float[Array, " n"]:
    return np.linalg.norm(TriangleBVH(vertices, faces).closest(points)[0] - points, axis=1)


def plane_residuals(points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance of each point from the least-squares plane through its nearest neighbours, itself not among them."""
    index = cKDTree(points).query(points, k=NEIGHBOURS + 1)[1][:, 1:]
    near = points[index]
    middle = near.mean(axis=1)
    offset = near - middle[:, None]
    normals = np.linalg.eigh(np.einsum("nkx,nky->nxy", offset, offset))[1][:, :, 0]
    return np.abs(((points - middle) * normals).sum(axis=1))


def seen(splats: Splats, centres: Float[Array, "n 3"]) -> Bool[Array, " n"]:
    """Whether half of the light of some direction reaches each centre past the splats in front of it.

    Parallel rays on a raster of 1/150 of the size; splats within a cell's width in front are of the same layer.
    """
    size = float(np.ptp(centres, axis=0).max())
    cell = size / RASTER
    pieces = cut(splats, cell, GaussiansConfig.model_validate({}).min_opacity)
    reached = np.zeros(len(centres), dtype=bool)
    for direction in view_directions():
        frame = np.linalg.svd(direction[None])[2]  # rows: the direction up to its sign, and two across
        depths, spots = pieces.points @ direction, pieces.points @ frame[1:].T
        low = spots.min(axis=0)
        across = np.floor((spots - low) / cell).astype(np.int64)
        width = int(across[:, 1].max()) + 1
        pixel = across[:, 0] * width + across[:, 1]
        near, far = float(depths.min()), float(depths.max()) + cell
        # One number sorts by pixel, then by depth.
        key = pixel + (depths - near) / (far - near)
        covered = np.minimum(pieces.areas * np.abs(pieces.normals @ direction) / cell**2, 1.0)
        order = np.argsort(key)
        absorbed = np.concatenate([[0.0], np.cumsum(-np.log1p(-np.minimum(pieces.weights * covered, 0.999))[order])])
        key = key[order]
        at = np.clip(np.floor((centres @ frame[1:].T - low) / cell).astype(np.int64), 0, None)
        own = at[:, 0] * width + np.minimum(at[:, 1], width - 1)
        before = np.clip((centres @ direction - cell - near) / (far - near), 0.0, 1.0 - 1e-9)
        depth = absorbed[np.searchsorted(key, own + before)] - absorbed[np.searchsorted(key, own)]
        reached |= depth <= np.log(2.0)
    return reached


def view_directions() -> Float[Array, "26 3"]:
    """Unit vectors to the points of a 3 x 3 raster on each side of a cube, those on its edges once."""
    raster = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 3)] * 3), axis=-1).reshape(-1, 3)
    surface = raster[np.abs(raster).max(axis=1) == 1.0]
    return surface / np.linalg.norm(surface, axis=1, keepdims=True)


def ray_shares(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], seed: int = 0
) -> tuple[float, float, float, float]:
    """Shares of random rays from outside: inside the mesh just behind their first hit; else by what they met."""
    rng = np.random.default_rng(seed)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    radius, size = float(np.linalg.norm(high - low)), float((high - low).max())
    tree = TriangleBVH(vertices, faces)
    origins, directions, found, face = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64)
    while len(origins) < RAYS:
        away = rng.standard_normal((4 * RAYS, 3))
        start = (low + high) / 2 + radius * away / np.linalg.norm(away, axis=1, keepdims=True)
        toward = low + (high - low) * rng.random((4 * RAYS, 3)) - start
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        hit, number = tree.first_hit(start, toward)[:2]
        met = np.isfinite(hit)
        origins = np.concatenate([origins, start[met]])[:RAYS]
        directions = np.concatenate([directions, toward[met]])[:RAYS]
        found, face = np.concatenate([found, hit[met]])[:RAYS], np.concatenate([face, number[met]])[:RAYS]
    behind = origins + (found + BEHIND * size)[:, None] * directions
    winding = igl.fast_winding_number(vertices, faces.astype(np.int64), behind)
    missed = np.asarray(winding).reshape(-1) <= 0.5
    normals = face_normals(vertices, faces)[face]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    hits, step = origins + found[:, None] * directions, 1e-6 * size
    thin = missed & (tree.first_hit(hits - step * normals, -normals)[0] < BEHIND * size)
    leaves = tree.first_hit(hits + step * directions, directions)[0]
    beyond = hits + np.where(np.isfinite(leaves), leaves + 2 * step, 0.0)[:, None] * directions
    pit = missed & ~thin & (tree.first_hit(beyond, directions)[0] < BEHIND * size)
    ridge = missed & ~thin & ~pit
    return float(1 - missed.mean()), float(thin.mean()), float(pit.mean()), float(ridge.mean())


def measure_colors(path: Path, options: dict[str, str], asset: Asset) -> dict[str, float]:
    """Learn the colours of the opaque splats: mean error where the surface is closest to their centres, and bytes."""
    config = GaussiansConfig.model_validate(options)
    kept = filter_splats(read_splat_file(path)[0], config, str(path))[0]
    splats = kept.take(kept.opacities > OPAQUE)
    colors = np.clip(splats.colours, 0.0, 1.0)
    learned = learn_colors(asset, ColoredPoints(splats.centres, colors))
    faces, barycentric, _ = asset.locate(splats.centres)
    found = np.clip(learned.asset.values("color", faces, barycentric), 0.0, 1.0)
    return {"color_error": float(np.abs(found - colors).mean()), "color_bytes": int(learned.report["field_bytes"])}


def mesh_counts(faces: Int[Array, "f 3"], vertex_count: int) -> tuple[int, int]:
    """Components and total genus of a closed mesh."""
    from ndf_core.mesh import topology

    counts = topology(faces, vertex_count)
    return counts.components, counts.genus


def picture(splats: Splats, vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], title: str) -> Array:
    """Opaque centres in their colours beside the mesh, from the front and from below behind."""
    turn = np.array([1.0, -1.0, -1.0])  # most files have y pointing down
    front = Camera.framing(vertices * turn, (30, 15), aspect=WIDTH / HEIGHT)
    shown = splats.take(splats.opacities > OPAQUE)
    images = [centres_picture(shown.centres * turn, shown.colours, front)]
    for view in ((30.0, 15.0), (200.0, -25.0)):
        images.append(render_mesh(vertices * turn, faces, width=WIDTH, height=HEIGHT, view=view))
    return panels(images, [f"{title}: opaque centres", "mesh", "from behind and below"])


def centres_picture(points: Float[Array, "n 3"], colours: Float[Array, "n 3"], camera: Camera) -> Array:
    """Squares of 3 x 3 pixels, near ones over far ones."""
    place = (points - camera.eye) @ camera.axes.T
    order = np.argsort(place[:, 2])
    pixel = np.rint(camera.project(points[order], WIDTH, HEIGHT)).astype(np.int64)
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    paint = np.round(np.clip(colours[order], 0, 1) * 255).astype(np.uint8)
    inside = ((pixel >= 1) & (pixel < [WIDTH - 1, HEIGHT - 1])).all(axis=1)
    offsets = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    rows = (pixel[inside][:, None] + offsets).reshape(-1, 2)
    image[rows[:, 1], rows[:, 0]] = np.repeat(paint[inside], len(offsets), axis=0)
    return image


if __name__ == "__main__":
    main()
