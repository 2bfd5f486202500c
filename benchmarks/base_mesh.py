"""Base meshes of closed meshes: topology, distance from the input, shape of the triangles, seconds.

Every file of the data folder at 1,000, 2,000 and 8,000 faces, as `ndf fit` makes them ("auto"), and at 2,000 faces by
marching cubes too. Seconds are of the processor, one thread. Distances are from 20,000 points spread evenly over the
base mesh to the input, as a share of the longest side; "pairs" are intersecting pairs of faces. What the base mesh
lacks of the input is in the remarks, which the JSON has in full.

    python benchmarks/base_mesh.py [NAME ...] [--data ../shared/data/mesh] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.base_mesh.from_mesh import MeshExtractor, Method
from ndf_core.base_mesh.intersections import self_intersections
from ndf_core.base_mesh.quantise import encode_base_mesh
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.mesh import face_normals, topology

HERE = Path(__file__).resolve().parent
FACES = (1000, 2000, 8000)
SAMPLES = 20_000
MERGE = 2.0**-28
"""Points closer than this share of the longest side are one; some STL files differ in the last bit."""
RUNS: tuple[tuple[Method, int], ...] = (*(("auto", count) for count in FACES), ("marching_cubes", 2000))
COLUMNS = ("faces", "same_topology", "pairs", "bits", "rms", "max", "angle_1", "angle_10", "angle_50", "seconds")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("names", nargs="*", help="parts of file names; all files by default")
    parser.add_argument("--data", type=Path, default=HERE.parent.parent / "shared" / "data" / "mesh")
    parser.add_argument("--output", type=Path, default=HERE / "results" / "base_mesh.json")
    arguments = parser.parse_args()
    results: list[dict[str, Any]] = []
    print(f"{'file':28} {'method':14}" + "".join(f"{name:>14}" for name in COLUMNS))
    for path in sorted(arguments.data.iterdir()):
        if arguments.names and not any(name in path.name for name in arguments.names):
            continue
        results.append(measure_file(path))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(results, indent=1) + "\n")


def measure_file(path: Path) -> dict[str, Any]:
    """All runs on one file, printed as they end."""
    vertices, faces = load(path)
    counts = topology(faces, len(vertices))
    entry: dict[str, Any] = {
        "file": path.name,
        "faces": counts.faces,
        "components": counts.components,
        "genus": counts.genus,
        "self_intersecting_pairs": len(self_intersections(vertices, faces)),
        "runs": [],
    }
    for method, count in RUNS:
        run = measure(vertices, faces, method, count)
        entry["runs"].append(run)
        values = "".join(f"{run[name]:>14.3g}" if run[name] is not None else f"{'-':>14}" for name in COLUMNS)
        print(f"{path.name[:28]:28} {method:14}" + values, flush=True)
    return entry


def measure(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], method: Method, count: int) -> dict[str, Any]:
    start = time.process_time()
    mesh = MeshExtractor(vertices, faces, method=method).extract(count)
    seconds = time.process_time() - start
    encoded = encode_base_mesh(mesh)
    before, after = topology(faces, len(vertices)), topology(encoded.faces, len(encoded.vertices))
    distances = distances_from(mesh.vertices, mesh.faces, vertices, faces)
    angles = min_angles(mesh.vertices, mesh.faces)
    return {
        "method": method,
        "asked": count,
        "faces": after.faces,
        "components": after.components,
        "genus": after.genus,
        "closed_manifold": after.closed and after.manifold,
        "same_topology": before.euler_characteristic == after.euler_characteristic
        and before.components == after.components,
        "pairs": len(self_intersections(encoded.vertices, encoded.faces)),
        "bits": encoded.bits,
        "bytes": len(encoded.blob),
        "rms": float(np.sqrt((distances**2).mean())),
        "max": float(distances.max()),
        "angle_1": float(np.percentile(angles, 1)),
        "angle_10": float(np.percentile(angles, 10)),
        "angle_50": float(np.percentile(angles, 50)),
        "seconds": round(seconds, 2),
        "remarks": [
            {"kind": r.kind, "message": r.message, "position": r.position, "size": r.size, "count": r.count}
            for r in mesh.remarks
        ],
    }


def load(path: Path) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"]]:
    loaded: Any = trimesh.load(path, process=False, force="mesh")
    vertices, faces = np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces)
    low = vertices.min(axis=0)
    cells = np.rint((vertices - low) / (np.ptp(vertices, axis=0).max() * MERGE))
    _, first, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1)[faces]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    used, faces = np.unique(faces[distinct], return_inverse=True)
    return vertices[first][used], faces.reshape(-1, 3).astype(np.int32)


def distances_from(
    points: Float[Array, "n 3"], corners: Int[Array, "m 3"], vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]
) -> Float[Array, " k"]:
    """Distances of points spread over one mesh from another, relative to the longest side of the second."""
    rng = np.random.default_rng(0)
    area = np.linalg.norm(face_normals(points, corners), axis=1)
    face = rng.choice(len(area), size=SAMPLES, p=area / area.sum())
    samples = np.einsum("ij,ijk->ik", rng.dirichlet([1, 1, 1], size=SAMPLES), points[corners[face]])
    nearest = TriangleBVH(vertices, faces).closest(samples)[0]
    return np.linalg.norm(nearest - samples, axis=1) / np.ptp(vertices, axis=0).max()


def min_angles(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, " f"]:
    """Smallest angle of each triangle, degrees."""
    corner = vertices[faces]
    u, v = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    cosine = (u * v).sum(axis=2) / (np.linalg.norm(u, axis=2) * np.linalg.norm(v, axis=2))
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).min(axis=1)


if __name__ == "__main__":
    main()
