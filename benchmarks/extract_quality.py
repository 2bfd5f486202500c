"""Are extracted meshes closed, manifold, Delaunay, evenly shaped and free of folds, for every shape and edge length?

    python benchmarks/extract_quality.py [--assets DIR] [--faces 1000 2000 8000] [--lengths 0.2 0.1 0.05 0.02 0.01]

Assets are DIR/<stem>_<faces>.ndf; missing ones are fitted first, shortly (800 steps). Edge lengths are in the box of
3. Everything is measured from the exported arrays. One row per mesh, and a summary per edge length, go to
results/extract_quality.json; what is there already is kept, so a run can be stopped and continued.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.errors import NdfError
from ndf_core.extract.extract import extract_mesh
from ndf_core.fitting.measure import facing_away
from ndf_core.fitting.projection import BoxProjector
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.kernels.mesh_check import check_mesh, measure_mesh
from ndf_core.mesh import face_normals, topology
from ndf_core.readers.mesh_file import read_mesh_file

HERE = Path(__file__).resolve().parent
STEPS = 800
MOST_PAIRS = 100_000


def min_angles(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, " f"]:
    """Smallest angle of each triangle, degrees."""
    corner = vertices[faces]
    smallest = np.full(len(faces), np.inf)
    for i in range(3):
        u, v = corner[:, (i + 1) % 3] - corner[:, i], corner[:, (i + 2) % 3] - corner[:, i]
        across = np.linalg.norm(np.cross(u, v), axis=1)
        smallest = np.minimum(smallest, np.degrees(np.arctan2(across, np.einsum("fk,fk->f", u, v))))
    return smallest


def measure(asset: Asset, edge_length: float, projector: BoxProjector) -> dict[str, Any]:
    """One row; `edge_length` in the box of 3, `projector` the input's."""
    start = time.process_time()
    mesh = extract_mesh(asset, edge_length * asset.content.scale)
    seconds = time.process_time() - start
    base = topology(asset.content.faces, len(asset.content.vertices))
    ours = topology(mesh.faces, len(mesh.vertices))
    angles = min_angles(mesh.vertices, mesh.faces)
    corner = mesh.vertices[mesh.faces]
    edges = np.linalg.norm(corner - corner[:, [1, 2, 0]], axis=2) / mesh.edge_length
    statistics = dict(mesh.statistics)
    return {
        "edge_length": edge_length,
        "vertices": ours.vertices,
        "cpu_microseconds_per_vertex": 1e6 * seconds / ours.vertices,
        "closed": ours.closed,
        "manifold": ours.manifold,
        "genus": ours.genus,
        "genus_right": (ours.genus, ours.components) == (base.genus, base.components),
        "delaunay": statistics["delaunay"],
        "delaunay_extrinsic": statistics["delaunay_extrinsic"],
        "angle_p1": float(np.percentile(angles, 1)),
        "angle_p01": float(np.percentile(angles, 0.1)),
        "angle_median": float(np.median(angles)),
        "longest_edge": float(edges.max()),
        "mean_edge": float(edges.mean()),
        "unsplit_edges": statistics["unsplit_edges"],
        "folded_area": statistics["folded_area"],
        "folded_off_input": folds_off_input(
            (mesh.vertices - asset.content.center) / asset.content.scale, mesh.faces, projector
        ),
        "self_intersections": len(TriangleBVH(mesh.vertices, mesh.faces).self_intersections(MOST_PAIRS)),
    }


def folds_off_input(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], projector: BoxProjector) -> float:
    """Share of the area in faces with an opposed neighbour that face against all of the input near them, too.

    Both sides of a blade have an opposed neighbour. Vertices are in the box frame; near is within three times the
    distance of the face's middle from the input, or the rms distance of those middles.
    """
    vectors = face_normals(vertices, faces)
    area = np.linalg.norm(vectors, axis=1)
    normals = vectors / np.maximum(area, np.finfo(float).tiny)[:, None]
    beside = check_mesh(faces, len(vertices)).twins.reshape(-1, 3) // 3
    opposed = np.flatnonzero(((normals[beside] * normals[:, None]).sum(2) < -0.5).any(1))
    if not len(opposed):
        return 0.0
    middles = vertices[faces[opposed]].mean(axis=1)
    found = projector.project(torch.from_numpy(middles))
    assert found.normals is not None, "a mesh has normals"
    against = (found.normals.numpy() * normals[opposed]).sum(1) < 0
    distance = np.linalg.norm(found.points.numpy() - middles, axis=1)
    reach = 3 * np.maximum(distance, np.sqrt((distance**2).mean()))[against]
    folded = opposed[against][facing_away(middles[against], normals[opposed][against], reach, projector)]
    return float(area[folded].sum() / area.sum())


def input_folds(path: Path) -> float:
    """Folded area of the input itself: sharp edges of less than 60 degrees count, folds or not."""
    mesh = read_mesh_file(path)
    vertices, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = number.ravel()[mesh.faces].astype(np.int32)
    return measure_mesh(vertices, faces, check_mesh(faces, len(vertices)).twins).folded_area


def fitted(mesh: Path, faces: int, folder: Path) -> Path:
    asset = folder / f"{mesh.stem}_{faces}.ndf"
    if not asset.exists():
        folder.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "ndf_core", "fit", str(mesh), "-o", str(asset), "--faces", str(faces)]
        subprocess.run([*command, "--steps", str(STEPS)], check=True, capture_output=True)
    return asset


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What the criteria speak of, over all shapes at one number of base faces and one edge length."""
    shapes = {row["shape"] for row in rows}
    return {
        "shapes": len(shapes),
        "closed_manifold_right_genus": sum(row["closed"] and row["manifold"] and row["genus_right"] for row in rows),
        "least_delaunay": min(row["delaunay"] for row in rows),
        "least_delaunay_extrinsic": min(row["delaunay_extrinsic"] for row in rows),
        "median_angle_p1": float(np.median([row["angle_p1"] for row in rows])),
        "angle_p1_below_10": sorted(row["shape"] for row in rows if row["angle_p1"] < 10),
        "folded_above_1e-4": {
            row["shape"]: {
                "extracted": row["folded_area"],
                "off_input": row["folded_off_input"],
                "input": row["input_folded_area"],
            }
            for row in rows
            if row["folded_area"] > 1e-4
        },
        "intersecting": {row["shape"]: row["self_intersections"] for row in rows if row["self_intersections"]},
        "median_cpu_microseconds_per_vertex": float(np.median([row["cpu_microseconds_per_vertex"] for row in rows])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parent.parent / "shared" / "data" / "mesh")
    parser.add_argument("--assets", type=Path, default=Path("/tmp/ndf-assets"))
    parser.add_argument("--faces", type=int, nargs="+", default=[1000, 2000, 8000])
    parser.add_argument("--lengths", type=float, nargs="+", default=[0.2, 0.1, 0.05, 0.02, 0.01])
    parser.add_argument("--only", nargs="+", help="stems of meshes")
    parser.add_argument("--again", action="store_true", help="measure also what the output has already")
    parser.add_argument("--output", type=Path, default=HERE / "results" / "extract_quality.json")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    if options.output.exists() and not options.again:
        rows = json.loads(options.output.read_text())["rows"]
    done = {(row["shape"], row["base_faces"], row["edge_length"]) for row in rows}
    for faces in options.faces:
        for path in sorted(options.data.iterdir()):
            if options.only and path.stem not in options.only:
                continue
            lengths = [length for length in options.lengths if (path.stem, faces, length) not in done]
            if not lengths:
                continue
            try:
                asset = Asset.load(fitted(path, faces, options.assets))
            except (NdfError, subprocess.CalledProcessError) as error:
                print(f"{path.stem} at {faces} faces: {error}", file=sys.stderr)
                continue
            projector = BoxProjector(ndf_core.open(path, "mesh").projector, asset.content.center, asset.content.scale)
            about = {"shape": path.stem, "base_faces": faces, "input_folded_area": input_folds(path)}
            for edge_length in lengths:
                rows.append({**about, **measure(asset, edge_length, projector)})
                print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
            write(options.output, rows)
    print(json.dumps(write(options.output, rows), indent=1))


def write(output: Path, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """All that is known by now; returns the summary."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(f"{row['base_faces']} faces, h = {row['edge_length']:g}", []).append(row)
    result = {name: summary(group) for name, group in groups.items()}
    output.parent.mkdir(exist_ok=True)
    output.write_text(json.dumps({"summary": result, "rows": rows}, indent=1) + "\n")
    return result


if __name__ == "__main__":
    main()
