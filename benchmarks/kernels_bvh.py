"""Closest points per second: our BVH beside libigl's AABB tree and, where it imports, open3d's ray-casting scene.

One thread. Near queries are evenly spread over the surface and moved by a normal deviate of 0.3% of the longest side,
as in training; far ones fill 1.5 bounding boxes. Times are the best of three runs, building apart.

    python benchmarks/kernels_bvh.py [--data ../shared/data] [--queries 200000] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import igl
import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.bvh import TriangleBVH

os.environ["IGL_NUM_THREADS"] = "1"  # read at libigl's first parallel loop
HERE = Path(__file__).resolve().parent
SHAPES = ("rocker-arm.obj", "nefertiti.obj", "igea_tri.ply")
FAR_SHARE = 10
"""One far query for so many near ones: they are some ten times slower."""

Query = Callable[[Float[Array, "n 3"]], Float[Array, "n 3"]]


def near_queries(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], count: int, rng: np.random.Generator
) -> Float[Array, "n 3"]:
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    face = rng.choice(len(faces), size=count, p=areas / areas.sum())
    weights = rng.dirichlet([1, 1, 1], size=count)
    on_surface = np.einsum("ij,ijk->ik", weights, corners[face])
    return on_surface + rng.normal(size=(count, 3)) * 0.003 * np.ptp(vertices, axis=0).max()


def far_queries(vertices: Float[Array, "v 3"], count: int, rng: np.random.Generator) -> Float[Array, "n 3"]:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return (low + high) / 2 + rng.uniform(-0.75, 0.75, size=(count, 3)) * (high - low)


def best_of_three(call: Callable[[], Any]) -> tuple[float, Any]:
    times: list[float] = []
    result = None
    for _ in range(3):
        start = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - start)
    return min(times), result


def ours(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Query:
    tree = TriangleBVH(vertices, faces)
    return lambda points: tree.closest(points)[0]


def libigl(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Query:
    tree = igl.AABB()
    faces = faces.astype(np.int64)
    tree.init(vertices, faces)
    return lambda points: tree.squared_distance(vertices, faces, points)[2]


def open3d(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Query:
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return lambda points: scene.compute_closest_points(points.astype(np.float32), nthreads=1)["points"].numpy()


ENGINES = {"ndf": ours, "libigl": libigl, "open3d": open3d}


def measure(path: Path, count: int) -> dict[str, Any]:
    """Build times, queries per second and the largest disagreement in distance, relative to the longest side."""
    vertices, faces = igl.read_triangle_mesh(str(path))
    vertices, faces = np.ascontiguousarray(vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int32)
    rng = np.random.default_rng(0)
    points = {
        "near": near_queries(vertices, faces, count, rng),
        "far": far_queries(vertices, max(1, count // FAR_SHARE), rng),
    }
    size = np.ptp(vertices, axis=0).max()
    distances: dict[str, Float[Array, " n"]] = {}
    row: dict[str, Any] = {"faces": len(faces), "engines": {}}
    for name, engine in ENGINES.items():
        try:
            seconds, query = best_of_three(lambda engine=engine: engine(vertices, faces))
        except ImportError as error:
            row["engines"][name] = {"missing": str(error)}
            continue
        entry: dict[str, Any] = {"build_seconds": seconds}
        for kind, rows in points.items():
            seconds, closest = best_of_three(lambda query=query, rows=rows: query(rows))
            distance = np.linalg.norm(np.asarray(closest, dtype=np.float64) - rows, axis=1)
            distances.setdefault(kind, distance)
            entry[f"{kind}_queries_per_second"] = len(rows) / seconds
            entry[f"{kind}_disagreement"] = float(np.abs(distance - distances[kind]).max() / size)
        row["engines"][name] = entry
    tree = TriangleBVH(vertices, faces)
    seconds, pairs = best_of_three(tree.self_intersections)
    row["self_intersections"] = {"seconds": seconds, "pairs": len(pairs)}
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parent / ".." / "shared" / "data", help="folder of meshes")
    parser.add_argument("--queries", type=int, default=200_000, help="near queries per shape")
    parser.add_argument("--output", type=Path, default=HERE / "results" / "kernels_bvh.json")
    options = parser.parse_args()
    result = {name: measure(options.data / "mesh" / name, options.queries) for name in SHAPES}
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(result, indent=2) + "\n")
    for shape, row in result.items():
        for name, entry in row["engines"].items():
            print(f"{shape:16} {name:8} " + ", ".join(f"{key} {value:.3g}" if isinstance(value, float) else value
                                                       for key, value in entry.items()))  # fmt: skip


if __name__ == "__main__":
    main()
