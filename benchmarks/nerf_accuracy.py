"""Trained NeRFs at 4,000 base faces: distance of the extracted mesh from the outer level set, and back.

The level set is made anew: the network at every node of a grid of 256 cells along the object, a flood from outside,
the parts that count, marching cubes. Distances are to the closest point, from 50,000 points even by area on either
side, as shares of the longest side. Besides: how far the interpolated grid's crossing is from the network's along the
same ray, the network's speed, and the base mesh by each of the two ways with its distance from the same level set.
Seconds are of the processor. Assets that `--assets` has already (NAME.ndf) are not fitted again.

    python benchmarks/nerf_accuracy.py [NAME ...] [--data ../shared/data/nerf] [--assets FOLDER] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from ndf_plugin_nerf.grid_extractor import GridExtractor, smoothed
from ndf_plugin_nerf.isosurface import Triangles, isosurface, sample_triangles
from ndf_plugin_nerf.lattice import Nodes
from ndf_plugin_nerf.nerf import NerfConfig
from ndf_plugin_nerf.outer_field import OuterField
from ndf_plugin_nerf.outside import flooded, parts_of
from ndf_plugin_nerf.ray_projector import RayProjector
from ndf_plugin_nerf.region import find_region
from ndf_plugin_nerf.sampled import sample_all
from ndf_plugin_nerf.source import read_density
from ndf_plugin_nerf.tsdf import fused

import ndf_core
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import topology
from ndf_core.render import panels, render_mesh, write_png

HERE = Path(__file__).resolve().parent
FACES = 4000
SAMPLES = 50_000
VIEWS = ((35.0, 25.0), (215.0, 20.0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=["lego", "materials", "hotdog"])
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data" / "nerf")
    parser.add_argument("--assets", type=Path, default=Path("nerf_assets"))
    parser.add_argument("--output", type=Path, default=HERE / "results" / "nerf_accuracy.json")
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.assets.mkdir(parents=True, exist_ok=True)
    rows = json.loads(options.output.read_text()) if options.output.is_file() else {}
    for name in options.names:
        rows[name] = measured(options.data / f"krrish_{name}.ckpt", options.assets / f"{name}.ndf")
        options.output.write_text(json.dumps(rows, indent=1) + "\n")
        print(name, json.dumps(rows[name], indent=1), flush=True)


def measured(path: Path, asset_path: Path) -> dict[str, Any]:
    config = NerfConfig()
    row: dict[str, Any] = {}
    if not asset_path.is_file():
        start = time.process_time()
        ndf_core.fit(ndf_core.open(path), faces=FACES, output=asset_path, threads=1)
        row["fit_seconds"] = time.process_time() - start
    density = read_density(path, config).density
    region = find_region(density, None, None, config.min_part)
    row["threshold"], row["notes"] = region.threshold, list(region.notes)
    reference = level_set(sample_all(density, nodes := Nodes.over(region.box, 256)), nodes, region.threshold, config)
    counts = topology(reference[1], len(reference[0]))
    row["level_set"] = {"faces": counts.faces, "components": counts.components, "genus": counts.genus}
    start = time.process_time()
    field = OuterField.of(density, region.box, region.threshold, config.resolution, config.min_part)
    row["cache"] = {"asked": field.asked, "nodes": field.nodes.total, "seconds": time.process_time() - start}
    row["cache"] |= cache_error(density, field, reference)
    row["points_per_second"] = speed(density, region.box.lower, region.box.upper)
    for kind, make in (("outer", smoothed), ("tsdf", fused)):
        start = time.process_time()
        mesh = GridExtractor(lambda make=make: make(field), field.remarks).extract(FACES)
        counts = topology(mesh.faces, len(mesh.vertices))
        row[f"base_{kind}"] = {
            "seconds": time.process_time() - start,
            "components": counts.components,
            "genus": counts.genus,
            **two_sided((mesh.vertices, mesh.faces), reference),
        }
    asset = ndf_core.load(asset_path)
    mesh = asset.extract()
    row["fit_options"] = asset.content.provenance["config"]
    row["asset_bytes"] = asset_path.stat().st_size
    row["extracted"] = {"vertices": len(mesh.vertices), **two_sided((mesh.vertices, mesh.faces), reference)}
    picture(asset_path.with_suffix(".png"), reference, asset, (mesh.vertices, mesh.faces))
    return row


def level_set(values: np.ndarray, nodes: Nodes, threshold: float, config: NerfConfig) -> Triangles:
    """The outer level set of a fully sampled grid."""
    parts = parts_of(~flooded(values < threshold))
    inside = (parts.label > 0) & (parts.label <= parts.of_share(config.min_part))
    excess = threshold - values
    return isosurface(nodes, np.where(inside, np.where(excess < 0, excess, -threshold), np.maximum(excess, 1e-6)))


def two_sided(mesh: Triangles, reference: Triangles) -> dict[str, Any]:
    """Distances as shares of the longest side of the mesh."""
    side = float(np.ptp(mesh[0], axis=0).max())
    rng = np.random.default_rng(0)
    found: dict[str, Any] = {}
    for name, source, target in (("to_level_set", mesh, reference), ("from_level_set", reference, mesh)):
        points, _ = sample_triangles(source, SAMPLES, rng)
        closest = TriangleBVH(*target).closest(points, 1)[0]
        share = np.linalg.norm(points - closest, axis=1) / side
        found[name] = {
            "mean": float(share.mean()),
            "median": float(np.median(share)),
            "rms": float(np.sqrt((share**2).mean())),
            "p99": float(np.quantile(share, 0.99)),
        }
    return found


def cache_error(density: Any, field: OuterField, reference: Triangles) -> dict[str, float]:
    """Along normals of the level set: crossing of the interpolated grid against that of the network."""
    points, normals = (
        torch.from_numpy(part) for part in sample_triangles(reference, 10_000, np.random.default_rng(1))
    )
    side = field.nodes.box.longest_side
    exact = RayProjector(density, field, 0.02 * side).project(points, normals)
    cached = RayProjector(Interpolated(field), field, 0.02 * side).project(points, normals)
    both = exact.converged & cached.converged
    off = ((exact.points - cached.points)[both].norm(dim=1) / side).numpy()
    return {
        "network_confirms": float(exact.converged[cached.converged].double().mean()),
        "crossing_error_median": float(np.median(off)),
        "crossing_error_mean": float(off.mean()),
        "crossing_error_p99": float(np.quantile(off, 0.99)),
    }


class Interpolated:
    """The grid in place of the density that it was sampled from."""

    def __init__(self, field: OuterField) -> None:
        self._function, self._threshold = field.function(), field.threshold

    def values(self, points: torch.Tensor) -> torch.Tensor:
        return self._threshold * (1.0 - self._function(points))


def speed(density: Any, lower: np.ndarray, upper: np.ndarray) -> float:
    points = torch.from_numpy(lower + np.random.default_rng(2).random((200_000, 3)) * (upper - lower))
    start = time.process_time()
    density.values(points)
    return len(points) / (time.process_time() - start)


def picture(path: Path, reference: Triangles, asset: Any, mesh: Triangles) -> None:
    content = asset.content
    base = content.vertices * content.scale + content.center, content.faces
    images, titles = [], []
    for view in VIEWS:
        for title, (vertices, faces), look in (
            ("outer level set", reference, {}),
            (f"base mesh, {len(base[1]):,} faces", base, {"wireframe": True, "crease": 0}),
            (f"extracted, {len(mesh[1]):,} faces", mesh, {}),
        ):
            images.append(
                render_mesh(vertices, faces, width=620, height=520, view=view, up="z", bounds=reference[0], **look)
            )
            titles.append(title)
    write_png(path, panels(images, titles, columns=3))


if __name__ == "__main__":
    main()
