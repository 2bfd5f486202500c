"""Ours beside Poisson reconstruction, alpha shapes and ball pivoting: closed? manifold? how far from the shape?

Inputs: 20,000 points sampled from closed meshes, clean, with noise (0.5% of the size, normals turned by 10 degrees),
and without normals; soups of the same shapes (a tenth of the triangles deleted, corners moved by 0.1%; ours alone);
real clouds; opaque centres of splats. Where a cloud has no normals the others get Open3D's, oriented along its
tangent planes; splats give the axis that they are thinnest along. Distances are means as shares of the size, from the
mesh to the shape (the cloud itself where it is real) and back; seconds are of the processor. The limits of the known
shapes are checked: the exit status is 1 if one is not met.

Needs Open3D (`pip install open3d`; on Linux libusb-1.0 too). Rows that are there already are kept unless --again.

    python benchmarks/reconstruction.py [NAME ...] [--steps 2000] [--pictures FOLDER] [--table]
    python benchmarks/reconstruction.py --shapes oded_sword.obj --seed 77 --ours-only --output other.json
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from ndf_plugin_pointcloud.triangles import Triangles
from numpy import ndarray as Array
from reconstruction_inputs import Input, inputs, of_shapes
from reconstruction_methods import METHODS, Mesh, used
from scipy.spatial import KDTree

import ndf_core
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import topology
from ndf_core.render.camera import Camera
from ndf_core.render.panels import panels
from ndf_core.render.png import write_png
from ndf_core.render.raycast import render_mesh

HERE = Path(__file__).resolve().parent
SAMPLES = 50_000
OURS = "ours"


@dataclass(frozen=True)
class Row:
    """One method on one input."""

    input: str
    method: str
    faces: int
    closed: bool
    manifold: bool
    components: int
    to_shape: float
    from_shape: float
    seconds: float
    limit: float | None
    """On both distances."""

    @property
    def error(self) -> float:
        return (self.to_shape + self.from_shape) / 2

    @property
    def met(self) -> bool:
        return self.limit is None or max(self.to_shape, self.from_shape) <= self.limit


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="inputs whose names contain one of these")
    parser.add_argument("--data", type=Path, default=HERE.parent.parent / "shared" / "data")
    parser.add_argument("--shapes", nargs="+", metavar="FILE", help="other closed meshes instead of all these inputs")
    parser.add_argument("--seed", type=int, default=0, help="of the points on them")
    parser.add_argument("--faces", type=int, default=4000)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--again", action="store_true", help="measure rows that are there already")
    parser.add_argument("--ours-only", action="store_true")
    parser.add_argument("--table", action="store_true", help="print the results as a table, measure nothing")
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--output", type=Path, default=HERE / "results" / "reconstruction.json")
    given = parser.parse_args()
    torch.set_num_threads(1)
    kept = json.loads(given.output.read_text())["rows"] if given.output.exists() else []
    rows = {(row["input"], row["method"]): Row(**row) for row in kept}
    if not given.table:
        for item in of_shapes(given.data, given.shapes, given.seed) if given.shapes else inputs(given.data):
            if given.names and not any(name in item.name for name in given.names):
                continue
            done = set() if given.again else {method for name, method in rows if name == item.name}
            meshes: dict[str, Mesh] = {}
            for method, mesh, seconds in reconstruct(item, given, done):
                meshes[method] = mesh
                rows[item.name, method] = row = measure(item, method, mesh, seconds)
                print(json.dumps(asdict(row)), flush=True)
            if meshes and given.pictures:
                given.pictures.mkdir(parents=True, exist_ok=True)
                write_png(given.pictures / f"{item.name}.png", picture(item, meshes))
            result = {"faces": given.faces, "steps": given.steps, "ratio": ratio(rows)}
            result["rows"] = [asdict(rows[key]) for key in sorted(rows)]
            given.output.write_text(json.dumps(result, indent=1) + "\n")
    print(table(rows))
    bad = [
        row for row in rows.values() if row.method.startswith(OURS) and not (row.met and row.closed and row.manifold)
    ]
    for row in bad:
        print(f"not met: {row}", file=sys.stderr)
    return 1 if bad else 0


def reconstruct(item: Input, given: argparse.Namespace, done: set[str]) -> Iterator[tuple[str, Mesh, float]]:
    """Meshes by method, with the processor seconds from the points to the mesh."""
    for name, options in item.ours.items():
        if name in done:
            continue
        start = time.process_time()
        surface = ndf_core.open(item.source, repr=item.representation, **options)
        asset = ndf_core.fit(surface, faces=given.faces, steps=given.steps, threads=1)
        mesh = asset.extract()
        yield name, used(mesh.vertices, mesh.faces), time.process_time() - start
    if item.points is None or given.ours_only:
        return
    for name, method in METHODS.items():
        if name not in done:
            start = time.process_time()
            mesh = method(item.points, item.normals, item.oriented)
            yield name, mesh, time.process_time() - start


def measure(item: Input, method: str, mesh: Mesh, seconds: float) -> Row:
    counts = topology(mesh.faces, len(mesh.vertices))
    samples = even(mesh.vertices, mesh.faces, seed=1)
    if item.shape is not None:
        truth = even(*item.shape, seed=2)
        to_shape = off(TriangleBVH(*item.shape), samples)
    else:
        assert item.points is not None
        truth = item.points
        to_shape = np.asarray(KDTree(truth).query(samples)[0])
    size = float(np.ptp(truth, axis=0).max())
    back = off(TriangleBVH(mesh.vertices, mesh.faces), truth)
    return Row(
        input=item.name,
        method=method,
        faces=len(mesh.faces),
        closed=counts.closed,
        manifold=counts.manifold,
        components=counts.components,
        to_shape=float(to_shape.mean()) / size,
        from_shape=float(back.mean()) / size,
        seconds=round(seconds, 1),
        limit=item.limit if method.startswith(OURS) else None,
    )


def even(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], seed: int) -> Float[Array, "n 3"]:
    return Triangles(vertices, faces.astype(np.int64), ()).sample(SAMPLES, np.random.default_rng(seed))[0]


def off(tree: TriangleBVH, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    return np.linalg.norm(tree.closest(points)[0] - points, axis=1)


def ratio(rows: dict[tuple[str, str], Row]) -> dict[str, float]:
    """Median over the inputs of our error over that of Poisson reconstruction: of the defaults, and of the best."""
    pairs: dict[str, dict[str, Row]] = {}
    for (name, method), row in rows.items():
        pairs.setdefault(name, {})[method] = row
    shared = [row for row in pairs.values() if "Poisson" in row and OURS in row]
    if not shared:
        return {}
    best = [min(r.error for name, r in row.items() if name.startswith(OURS)) / row["Poisson"].error for row in shared]
    return {
        "defaults": float(np.median([row[OURS].error / row["Poisson"].error for row in shared])),
        "with --orient where there are no normals": float(np.median(best)),
    }


def table(rows: dict[tuple[str, str], Row]) -> str:
    lines = [
        "| input | method | closed | manifold | parts | to shape | back | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for key in sorted(rows):
        row = rows[key]
        flags = " | ".join("yes" if flag else "no" for flag in (row.closed, row.manifold))
        distances = f"{row.to_shape:.1e} | {row.from_shape:.1e}"
        lines.append(
            f"| {row.input} | {row.method} | {flags} | {row.components:,} | {distances} | {row.seconds:.0f} |"
        )
    return "\n".join([*lines, "", *(f"ours / Poisson, median, {name}: {x:.2f}" for name, x in ratio(rows).items())])


def picture(item: Input, meshes: dict[str, Mesh]) -> Any:
    reference = item.shape[0] if item.shape is not None else item.points
    assert reference is not None
    camera = Camera.framing(reference, (30, 20), aspect=1.0)
    images = [render_mesh(m.vertices, m.faces, width=420, height=420, view=camera) for m in meshes.values()]
    return panels(images, list(meshes), item.name)


if __name__ == "__main__":
    sys.exit(main())
