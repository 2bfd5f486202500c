"""How to compile the hot loops: a small C extension, numba, or numpy over BLAS. Measured, one thread.

Two loops that stand for the rest: evaluating the field (floating point, 2 x 64 network, eight levels, d = 16) and
linking half-edges (integers, irregular memory). Each way runs in processes of its own: once with nothing cached, as
after an installation, and again. `seconds_first` and `seconds_cached` are from before the import of the way's module
to the end of the first calls, numpy imported already. All are CPU seconds, which other processes disturb least.

    python benchmarks/kernels_choice.py [--points 200000] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

HERE = Path(__file__).resolve().parent
KERNELS = HERE.parent / "ndf_core" / "kernels"
WAYS = ("c", "numba", "blas")
LEVELS, FEATURES, WIDTH, FREQUENCY = 8, 16, 64, np.pi / 3
INPUTS = 3 + 6 * LEVELS + FEATURES

Evaluate = Callable[[], Float[Array, "n 3"]]
Link = Callable[[], Int[Array, " h"]]


def torus(around: int, across: int) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"]]:
    """Closed mesh of 2 * around * across faces."""
    u, v = np.meshgrid(2 * np.pi * np.arange(around) / around, 2 * np.pi * np.arange(across) / across, indexing="ij")
    radius = 1 + 0.4 * np.cos(v)
    points = np.stack([radius * np.cos(u), radius * np.sin(u), 0.4 * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    k, m = (i + 1) % around, (j + 1) % across
    a, b, c, d = i * across + j, k * across + j, k * across + m, i * across + m
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def task(points: int) -> dict[str, Array]:
    """Random weights and queries over a base mesh of 2,000 faces, and a mesh with as many vertices as queries."""
    rng = np.random.default_rng(0)
    vertices, base_faces = torus(50, 20)
    widths = [INPUTS, WIDTH, WIDTH, 3]
    weights = [rng.normal(size=(b, a)).astype(np.float32) * np.float32((2 / a) ** 0.5) for a, b in pairwise(widths)]
    return {
        "vertices": vertices,
        "base_faces": base_faces,
        "features": rng.normal(size=(len(vertices), FEATURES)).astype(np.float32),
        "faces": rng.integers(0, len(base_faces), size=points).astype(np.int32),
        "barycentric": rng.dirichlet((1.0, 1.0, 1.0), size=points),
        "mesh": torus(points // 200, 200)[1],
        **{f"weights{i}": array for i, array in enumerate(weights)},
        **{f"biases{i}": (rng.normal(size=len(array)) * 0.1).astype(np.float32) for i, array in enumerate(weights)},
    }


def c_way(data: dict[str, Array]) -> tuple[Evaluate, Link]:
    from ndf_core.kernels.field import FieldArrays, evaluate_field
    from ndf_core.kernels.mesh_check import check_mesh

    parts = [data[f"{kind}{i}"].ravel() for i in range(3) for kind in ("weights", "biases")]
    widths = np.array([INPUTS, WIDTH, WIDTH, 3], np.int32)
    field = FieldArrays(FREQUENCY, LEVELS, True, data["features"], widths, np.concatenate(parts), True)
    where = data["faces"], data["barycentric"], data["vertices"], data["base_faces"]
    mesh, count = data["mesh"], int(data["mesh"].max()) + 1
    return lambda: evaluate_field(field, *where), lambda: check_mesh(mesh, count).twins.ravel()


def blas_way(data: dict[str, Array]) -> tuple[Evaluate, Link]:
    def evaluate() -> Float[Array, "n 3"]:
        answer = np.empty((len(data["faces"]), 3), np.float32)
        for start in range(0, len(answer), 1024):  # blocks that stay in the cache
            block = slice(start, start + 1024)
            corners = data["base_faces"][data["faces"][block]]
            weights = data["barycentric"][block].astype(np.float32)[:, None, :]
            x = (weights @ data["vertices"].astype(np.float32)[corners])[:, 0]
            current = np.empty((len(x), INPUTS), np.float32)
            current[:, :3] = x
            sine, cosine = np.sin(x * np.float32(FREQUENCY)), np.cos(x * np.float32(FREQUENCY))
            for level in range(LEVELS):  # the cheapest way: doubling the angle, at the cost of accuracy
                current[:, 3 + 6 * level : 6 + 6 * level] = sine
                current[:, 6 + 6 * level : 9 + 6 * level] = cosine
                sine, cosine = 2 * sine * cosine, 1 - 2 * sine * sine
            current[:, -FEATURES:] = (weights @ data["features"][corners])[:, 0]
            for i in range(3):
                current = current @ data[f"weights{i}"].T + data[f"biases{i}"]
                if i < 2:
                    np.maximum(current, 0, out=current)
            answer[block] = current + x
        return answer

    def link() -> Int[Array, " h"]:
        faces = data["mesh"].astype(np.int64)
        start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
        key = np.minimum(start, end) * (faces.max() + 1) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        pairs = np.flatnonzero(key[order][1:] == key[order][:-1])
        twins = np.full(len(key), -1, np.int32)
        twins[order[pairs]], twins[order[pairs + 1]] = order[pairs + 1], order[pairs]
        return twins

    return evaluate, link


def numba_way(data: dict[str, Array]) -> tuple[Evaluate, Link]:
    from kernels_choice_numba import field, twins_of

    layers = [data[f"{kind}{i}"] for i in range(3) for kind in ("weights", "biases")]
    where = data["faces"], data["barycentric"], data["vertices"], data["base_faces"], data["features"]

    def evaluate() -> Float[Array, "n 3"]:
        answer = np.empty((len(data["faces"]), 3), np.float32)
        field(*where, *layers, answer, FREQUENCY, LEVELS)
        return answer

    return evaluate, lambda: twins_of(data["mesh"], int(data["mesh"].max()) + 1)


def child(way: str, points: int) -> None:
    """Run one way in this process and print its figures."""
    small, data = task(400), task(points)
    start = time.process_time()
    make = {"c": c_way, "numba": numba_way, "blas": blas_way}[way]
    for call in make(small):
        call()
    seconds = time.process_time() - start
    figures: dict[str, float] = {"seconds": seconds}
    answers: list[Array] = []
    for name, call in zip(("field", "link"), make(data), strict=True):
        answers.append(call())
        times: list[float] = []
        for _ in range(5):
            start = time.process_time()
            call()
            times.append(time.process_time() - start)
        figures[f"{name}_microseconds_per_vertex"] = min(times) / points * 1e6
    figures["field_sum"], figures["link_sum"] = (
        float(np.abs(answers[0]).sum()),
        int(answers[1].astype(np.int64).sum()),
    )
    print(json.dumps(figures))


def run_child(way: str, points: int, cache: str) -> dict[str, float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, __file__, "--child", way, "--points", str(points)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def installed_megabytes(*distributions: str) -> float:
    files = [file for name in distributions for file in importlib.metadata.files(name) or []]
    return sum(Path(str(file.locate())).stat().st_size for file in files if Path(str(file.locate())).is_file()) / 1e6


def build(folder: str) -> tuple[float, float]:
    """Seconds to compile the two C kernels as setup.py does, and their megabytes."""
    start, size = os.times().children_user, 0
    for name in ("field", "mesh_check"):
        output = Path(folder) / f"{name}.so"
        flags = ["-O3", "-fno-math-errno", "-std=c11", "-shared", "-fPIC", "-DPy_LIMITED_API=0x030B0000"]
        include = "-I" + sysconfig.get_path("include")
        source = str(KERNELS / "src" / f"{name}.c")
        subprocess.run(["cc", *flags, include, source, "-o", str(output), "-lm"], check=True)
        size += output.stat().st_size
    return os.times().children_user - start, size / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=200_000)
    parser.add_argument("--output", type=Path, default=HERE / "results" / "kernels_choice.json")
    parser.add_argument("--child", choices=WAYS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(options.child, options.points)
        return
    result: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for way in WAYS:
            first = run_child(way, options.points, folder)
            again = run_child(way, options.points, folder)
            result[way] = {"seconds_first": first.pop("seconds"), "seconds_cached": again.pop("seconds"), **again}
        result["c"]["build_seconds"], result["c"]["install_megabytes"] = build(folder)
    result["numba"]["install_megabytes"] = installed_megabytes("numba", "llvmlite")
    result["blas"]["install_megabytes"] = 0.0
    for name, tolerance in (("field_sum", 1e-4), ("link_sum", 0)):  # the three ways compute the same
        sums = [result[way].pop(name) for way in WAYS]
        assert np.allclose(sums, sums[0], rtol=tolerance, atol=0), (name, sums)
    text = json.dumps({"points": options.points, **result}, indent=1)
    options.output.parent.mkdir(exist_ok=True)
    options.output.write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
