"""Oriented clouds of growing size: what grows with the number of points, and what does not.

Points are drawn evenly by area from a closed mesh; the same base mesh size and steps for all. Seconds are of the
processor, one thread. "open" holds duplicates, areas and the tree, "base mesh" marching cubes of the winding number
and decimation, "train" the steps with their projections; "projection" is one alone, in microseconds.

    python benchmarks/point_clouds.py [--points 10000 100000 1000000] [--mesh FILE] [--steps 300] [--figure FILE.png]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

import ndf_core
from ndf_core.config.resolve import Given, resolve_config
from ndf_core.fitting.observer import Silent
from ndf_core.fitting.pipeline import run_fit
from ndf_core.mesh import face_normals
from ndf_core.readers.mesh_file import read_mesh_file

HERE = Path(__file__).resolve().parent
QUERIES = 20_000
STAGES = ("open", "base_mesh", "train")


class StageClock(Silent):
    """Processor seconds of each stage of a fit."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._name, self._start = "", 0.0

    def stage(self, name: str) -> None:
        self.close()
        self._name, self._start = name.replace(" ", "_"), time.process_time()

    def close(self) -> None:
        """End the stage that runs."""
        if self._name:
            self.seconds[self._name] = time.process_time() - self._start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--points", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument(
        "--mesh", type=Path, default=HERE.parent.parent / "shared" / "data" / "mesh" / "armadillo.obj"
    )
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--faces", type=int, default=4000)
    parser.add_argument("--output", type=Path, default=HERE / "results" / "point_clouds.json")
    parser.add_argument("--figure", type=Path)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    raw = read_mesh_file(arguments.mesh)
    rows: list[dict[str, Any]] = []
    for count in arguments.points:
        points, normals = sample(raw.vertices, raw.faces, count)
        rows.append({"points": count, **measure(points, normals, arguments.steps, arguments.faces)})
        print(json.dumps(rows[-1]), flush=True)
    result = {"mesh": arguments.mesh.name, "steps": arguments.steps, "faces": arguments.faces, "rows": rows}
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(result, indent=1) + "\n")
    if arguments.figure:
        draw(rows, arguments.figure)


def sample(vertices: Array, faces: Array, count: int) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Points even by area and the normals of their triangles."""
    rng = np.random.default_rng(0)
    vectors = face_normals(vertices, faces)
    areas = np.linalg.norm(vectors, axis=1)
    face = rng.choice(len(areas), count, p=areas / areas.sum())
    root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    a, b, c = (vertices[faces[face, k]] for k in range(3))
    return (1 - root) * a + root * (1 - along) * b + root * along * c, vectors[face] / areas[face, None]


def measure(points: Float[Array, "n 3"], normals: Float[Array, "n 3"], steps: int, faces: int) -> dict[str, Any]:
    """Open and fit one cloud."""
    start = time.process_time()
    surface = ndf_core.open((points, normals), repr="oriented-points")
    opened = time.process_time() - start
    size = float(np.ptp(points, axis=0).max())
    rng = np.random.default_rng(1)
    rows = rng.choice(len(points), min(QUERIES, len(points)), replace=False)
    queries = torch.from_numpy(points[rows] + rng.uniform(-0.01, 0.01, (len(rows), 1)) * size * normals[rows])
    start = time.process_time()
    converged = surface.projector.project(queries).converged.double().mean()
    projection = (time.process_time() - start) / len(rows)
    given = Given(fit={"steps": steps, "faces": faces, "threads": 1})
    config = resolve_config(given=given, training_defaults=surface.training_defaults).fit.config
    clock = StageClock()
    report = run_fit(surface, config, observer=clock).report
    clock.close()
    return {
        "open": round(opened, 2),
        **{name: round(seconds, 2) for name, seconds in clock.seconds.items()},
        "projection_microseconds": round(1e6 * projection, 1),
        "converged": float(converged),
        "projection_rms_relative": report["projection_rms_relative"],
    }


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Seconds over points, both logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
    count = [row["points"] for row in rows]
    for name in STAGES:
        axes.loglog(count, [row[name] for row in rows], marker="o", label=name.replace("_", " "))
    axes.set(xlabel="points", ylabel="seconds of one core")
    axes.legend()
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
