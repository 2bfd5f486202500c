"""How long does `ndf fit` take for 100,000 points with normals, without them, and a soup of 100,000 triangles?

Everything is counted: the command's start, reading, base mesh, training, measuring, writing. Defaults but for 4,000
base faces. Points are drawn evenly by area from armadillo; the soup is scorpion (99,990 triangles), each corner of
each triangle moved by 0.1% of the size, so that nothing is connected any more. The exit status is 1 if a limit
(seconds of the clock on two cores) is not met.

    python benchmarks/cloud_times.py [--only NAME] [--threads N] [--output F.json]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from point_clouds import sample
from representations import fit_figures, refusal, run

from ndf_core.meshio import write_mesh
from ndf_core.readers.mesh_file import read_mesh_file

HERE = Path(__file__).resolve().parent
COUNT, JITTER = 100_000, 1e-3
LIMITS = {"oriented-points": 360, "soup": 360, "points": 120}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=LIMITS, nargs="+", default=list(LIMITS))
    parser.add_argument("--data", type=Path, default=HERE.parents[1] / "shared" / "data")
    parser.add_argument("--threads", type=int, default=0, help="0 for all, as by default")
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds of the clock after which a fit is ended")
    parser.add_argument("--output", type=Path, default=HERE / "results" / "cloud_times.json")
    options = parser.parse_args()
    rows: dict[str, Any] = json.loads(options.output.read_text()) if options.output.is_file() else {}
    for name in options.only:
        with tempfile.TemporaryDirectory() as folder:
            rows[name] = timed(name, options.data / "mesh", Path(folder), options.threads, options.limit)
        options.output.write_text(json.dumps(rows, indent=1) + "\n")
        print(f"{name}: {json.dumps(rows[name])}", flush=True)
    return int(any(row["wall"] > row["limit"] for row in rows.values()))


def timed(name: str, meshes: Path, folder: Path, threads: int, limit: float) -> dict[str, Any]:
    """Fit one input in a process of its own."""
    path = folder / "input.ply"
    if name == "soup":
        raw = read_mesh_file(meshes / "oded_scorpion.obj")
        size = float(np.ptp(raw.vertices, axis=0).max())
        corners = raw.vertices[raw.faces]
        corners = corners + JITTER * size * np.random.default_rng(0).uniform(-1, 1, corners.shape)
        triangles: Int[Array, "f 3"] = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
        write_mesh(path, corners.reshape(-1, 3), triangles)
    else:
        raw = read_mesh_file(meshes / "armadillo.obj")
        points, normals = sample(raw.vertices, raw.faces, COUNT)
        write_points(path, points, normals if name == "oriented-points" else None)
    words = ["fit", str(path), "-o", str(folder / "a.ndf"), "--faces", "4000", "--json"]
    done = run([*words, *(["--threads", str(threads)] if threads else [])], limit)
    if done.status != 0:
        sys.exit(f"{name}: {refusal(done) if done.status else 'not done in time'}")
    figures = fit_figures(json.loads(done.output))
    assert figures["representation"] == name, figures["representation"]
    kept = ("stages", "converged", "field_to_surface", "surface_to_field")
    seconds = {"limit": LIMITS[name], "wall": round(done.wall, 1), "cpu": round(done.cpu, 1)}
    return {"threads": threads or os.cpu_count(), **seconds, **{key: figures[key] for key in kept}}


def write_points(path: Path, points: Float[Array, "n 3"], normals: Float[Array, "n 3"] | None) -> None:
    """A binary PLY of single precision."""
    names = ["x", "y", "z", *(["nx", "ny", "nz"] if normals is not None else [])]
    table = points if normals is None else np.concatenate([points, normals], axis=1)
    properties = "".join(f"property float {name}\n" for name in names)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{properties}end_header\n"
    path.write_bytes(header.encode() + table.astype("<f4").tobytes())


if __name__ == "__main__":
    sys.exit(main())
