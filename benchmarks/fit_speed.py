"""Seconds to the paper's accuracy: `--recipe paper` against `--recipe fast`, same surface, projector and kernels.

The paper recipe runs once per shape and is cached in `results/fit_speed_paper_<shape>.json`; the fast one runs every
time, from the same base mesh; the output keeps the last run of each shape. Each clock counts the initialisation and
the training, not the evaluations, and stops at the first evaluation whose two-sided rms is at or below the paper
run's final one. Machines differ from day to day, so some steps of the paper recipe are timed before and after each
fast run: `ratio` sets its samples at that rate (initialisation left out) against the fast run, in CPU seconds. Ratios
to the seconds that the cached run took are given beside it.

    python benchmarks/fit_speed.py ../shared/data/mesh/rocker-arm.obj ... [--threads 1] [--figure fit_speed.png]
"""

from __future__ import annotations

import argparse
import base64
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch

import ndf_core
from ndf_core.asset.base_mesh_codec import decode_base_mesh
from ndf_core.base_mesh.quantise import encode_base_mesh
from ndf_core.config.fit import FitConfig
from ndf_core.config.resolve import Given, resolve_config
from ndf_core.fitting.blocks import NumpyField
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.identity import initial_parameters
from ndf_core.fitting.measure import measure
from ndf_core.fitting.observer import Observers
from ndf_core.fitting.projection import BoxProjector
from ndf_core.fitting.trainer import Trainer
from ndf_core.interfaces import Surface

RESULTS = Path(__file__).parent / "results"


def base_mesh_of(surface: Surface, config: FitConfig) -> dict[str, Any]:
    """The encoded base mesh as JSON, so that both recipes and later runs start from the same one."""
    encoded = encode_base_mesh(surface.base_mesh.extract(config.faces, config.seed))
    return {
        "vertices": len(encoded.vertices),
        "faces": len(encoded.faces),
        "center": encoded.center.tolist(),
        "scale": encoded.scale,
        "blob": base64.b64encode(encoded.blob).decode(),
    }


def decoded(base: dict[str, Any]) -> tuple[BaseGeometry, np.ndarray, float]:
    """The base mesh with the centre and the scale of its box."""
    vertices, faces = decode_base_mesh(base64.b64decode(base["blob"]), base["vertices"], base["faces"])
    return BaseGeometry(vertices, faces), np.array(base["center"]), float(base["scale"])


def samples_per_cpu_second(path: Path, config: FitConfig, base: dict[str, Any], steps: int = 12) -> float:
    """Of a recipe, on this machine now; a few steps come before, and the initialisation is left out."""
    torch.set_num_threads(1)
    geometry, center, scale = decoded(base)
    projector = BoxProjector(ndf_core.open(path).projector, center, scale)
    config = config.model_copy(update={"identity_steps": 0})
    trainer = Trainer(
        initial_parameters(geometry, config), geometry, projector, config, Observers(), threads=config.threads
    )
    trainer.run(2, save=lambda: None)
    start = time.process_time()
    trainer.run(2 + steps, save=lambda: None)
    return steps * config.batch / (time.process_time() - start)


def run(path: Path, config: FitConfig, evaluations: int, samples: int, base: dict[str, Any] | None) -> dict[str, Any]:
    """Fit once, stopping the clock for evaluations; their steps are spread so that the early ones are dense."""
    torch.set_num_threads(1)
    surface = ndf_core.open(path)
    base = base or base_mesh_of(surface, config)
    geometry, center, scale = decoded(base)
    projector = BoxProjector(surface.projector, center, scale)
    wall, cpu = time.perf_counter(), time.process_time()
    parameters = initial_parameters(geometry, config)
    trainer = Trainer(parameters, geometry, projector, config, Observers(), threads=config.threads)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    initialise = wall
    curve: list[dict[str, float]] = []
    field = NumpyField(parameters, geometry)
    marks = sorted(
        {round(config.steps * (i / evaluations) ** 1.5) for i in range(1, evaluations + 1)} | {config.steps}
    )
    for mark in marks:
        wall_start, cpu_start = time.perf_counter(), time.process_time()
        trainer.run(mark, save=lambda: None)
        wall += time.perf_counter() - wall_start
        cpu += time.process_time() - cpu_start
        accuracy = measure(
            field.map, base["faces"], surface, center, scale, field.base, field.inverse, samples, seed=1
        )
        backward = accuracy.surface_to_field
        curve.append(
            {
                "step": mark,
                "samples": mark * config.batch,
                "seconds": wall,
                "cpu_seconds": cpu,
                "field_to_surface_rms": accuracy.field_to_surface.rms,
                "surface_to_field_rms": backward.rms if backward else float("nan"),
                "two_sided_rms": accuracy.two_sided_rms,
                "cycle_loss": accuracy.cycle_loss or 0.0,
                "folded_area": accuracy.folded_area or 0.0,
            }
        )
        print(
            f"  {config.recipe} {path.stem}",
            json.dumps({k: float(f"{v:.4g}") for k, v in curve[-1].items()}),
            flush=True,
        )
    return {
        "file": path.name,
        "recipe": config.recipe,
        "threads": config.threads,
        "base_mesh": base,
        "initialise_seconds": initialise,
        "samples_per_second": config.steps * config.batch / (wall - initialise),
        "samples_per_cpu_second": config.steps * config.batch / (cpu - initialise),
        "config": config.model_dump(),
        "curve": curve,
    }


def paper_cache(name: str) -> Path:
    """Where the paper run of an input is kept."""
    return RESULTS / f"fit_speed_paper_{Path(name).stem}.json"


def configure(recipe: str, options: dict[str, Any]) -> FitConfig:
    """The recipe with some options set; strings are converted."""
    return resolve_config(given=Given(fit={"recipe": recipe, **options})).fit.config


def first_at(curve: list[dict[str, float]], target: float) -> dict[str, float] | None:
    """First evaluation at or below the target."""
    return next((point for point in curve if point["two_sided_rms"] <= target), None)


def compare(paper: dict[str, Any], fast: dict[str, Any]) -> dict[str, Any]:
    """Both clocks at the paper run's final two-sided rms, and at the lowest that it ever had."""
    return {
        "file": paper["file"],
        **at_error(paper, fast, paper["curve"][-1]["two_sided_rms"]),
        # The paper recipe's rate is constant, so its error goes up and down to the end.
        "at_lowest": at_error(paper, fast, min(point["two_sided_rms"] for point in paper["curve"])),
        "paper_samples_per_cpu_second": fast["paper_samples_per_cpu_second"],
        "cached_paper_samples_per_cpu_second": paper["samples_per_cpu_second"],
    }


def at_error(paper: dict[str, Any], fast: dict[str, Any], target: float) -> dict[str, Any]:
    """Where both runs first meet a two-sided rms, and by how much the fast one is ahead."""
    theirs, ours = first_at(paper["curve"], target), first_at(fast["curve"], target)
    result: dict[str, Any] = {"target_two_sided_rms": target, "paper": theirs, "fast": ours}
    if theirs and ours:
        result["ratio"] = theirs["samples"] / fast["paper_samples_per_cpu_second"] / ours["cpu_seconds"]
        result["ratio_cached_seconds"] = theirs["seconds"] / ours["seconds"]
        result["ratio_cached_cpu"] = theirs["cpu_seconds"] / ours["cpu_seconds"]
        result["ratio_samples"] = theirs["samples"] / ours["samples"]
    return result


def figure(pairs: list[tuple[dict[str, Any], dict[str, Any]]], path: Path) -> None:
    """Error against seconds and against samples, one column per shape."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    _, axes = plt.subplots(2, len(pairs), figsize=(4.2 * len(pairs), 7), squeeze=False)
    for column, (paper, fast) in enumerate(pairs):
        target = paper["curve"][-1]["two_sided_rms"]
        for row, key in enumerate(("seconds", "samples")):
            axis = axes[row][column]
            for result, colour in ((paper, "tab:gray"), (fast, "tab:blue")):
                xs, ys = zip(*[(p[key], p["two_sided_rms"]) for p in result["curve"]], strict=True)
                axis.loglog(xs, ys, "o-", ms=3, color=colour, label=result["recipe"])
            axis.axhline(target, color="tab:gray", lw=0.6, ls=":")
            axis.set_xlabel(f"training {key}, {paper['threads']} thread(s)" if key == "seconds" else "samples")
        axes[0][column].set_title(Path(paper["file"]).stem)
    axes[0][0].set_ylabel("two-sided rms / longest side")
    axes[1][0].set_ylabel("two-sided rms / longest side")
    axes[0][0].legend()
    plt.tight_layout()
    plt.savefig(path, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", type=Path, nargs="+")
    parser.add_argument("--faces", type=int, default=2000)
    parser.add_argument("--feature-dim", type=int, default=16)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--samples", type=int, default=50_000)
    parser.add_argument("--evaluations", type=int, default=30, help="of the fast recipe")
    parser.add_argument("--paper-only", action="store_true", help="fill the cache and stop")
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="KEY=VALUE", help="options of the fast recipe to change"
    )
    parser.add_argument("--figure", type=Path, default=RESULTS / "fit_speed.png")
    parser.add_argument("--output", type=Path, default=RESULTS / "fit_speed.json")
    arguments = parser.parse_args()
    common = {"faces": arguments.faces, "feature_dim": arguments.feature_dim, "threads": arguments.threads}
    known = json.loads(arguments.output.read_text())["fast"] if arguments.output.exists() else []
    runs: dict[str, dict[str, Any]] = {run["file"]: run for run in known}
    for path in arguments.inputs:
        cache = paper_cache(path.name)
        if cache.exists():
            paper = json.loads(cache.read_text())
        else:
            paper = run(path, configure("paper", common), evaluations=40, samples=arguments.samples, base=None)
            cache.write_text(json.dumps(paper, indent=1))
        if not arguments.paper_only:
            changes = dict(item.split("=", 1) for item in arguments.set)
            base, recipe = paper["base_mesh"], configure("paper", common)
            before = samples_per_cpu_second(path, recipe, base)
            fast = run(
                path,
                configure("fast", {**common, **changes}),
                evaluations=arguments.evaluations,
                samples=arguments.samples,
                base=base,
            )
            # The faster of both: what slows one of them for a moment must not flatter the ratio.
            fast["paper_samples_per_cpu_second"] = max(before, samples_per_cpu_second(path, recipe, base))
            runs[path.name] = fast
            print(json.dumps(compare(paper, fast), indent=1), flush=True)
    if not arguments.paper_only:
        pairs = [(json.loads(paper_cache(name).read_text()), fast) for name, fast in sorted(runs.items())]
        arguments.output.write_text(
            json.dumps({"summary": [compare(*pair) for pair in pairs], "fast": [f for _, f in pairs]}, indent=1)
        )
        figure(pairs, arguments.figure)


if __name__ == "__main__":
    main()
