"""What `extraction.py`'s measurements say, and their figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

TASKS = ("geodesics", "spectrum")
WINDOW = (0.3, 10.0)
"""Seconds between which no alternative may beat ours in both axes."""


def total(entry: dict[str, Any], task: str) -> float:
    """Extraction and solution; with the query of the solution where there is one."""
    seconds = entry["seconds"]
    return seconds["extract"] + seconds[task] + (seconds["query"] if task == "geodesics" else 0.0)


def points(result: dict[str, Any], task: str, own: bool | None = None) -> list[dict[str, Any]]:
    """Time and error of every run that did the task, ours or the others'."""
    return [
        {
            "method": entry["method"],
            "size": entry["size"],
            "vertices": entry["vertices"],
            "seconds": total(entry, task),
            "error": entry[f"{task}_error"],
        }
        for entry in result["runs"]
        if f"{task}_error" in entry and (own is None or own == (entry["method"] == "ours"))
    ]


def dominated(mine: list[dict[str, Any]], theirs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Points of ours within the window that an alternative beats in both axes, with the closest such alternative."""
    found: list[dict[str, Any]] = []
    for point in mine:
        if not WINDOW[0] <= point["seconds"] <= WINDOW[1]:
            continue
        better = [one for one in theirs if one["seconds"] < point["seconds"] and one["error"] < point["error"]]
        if better:
            found.append({"ours": point, "by": min(better, key=lambda one: one["seconds"])})
    return found


def front(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The runs that no other of them beats in both axes, from fast to slow."""
    kept: list[dict[str, Any]] = []
    for one in sorted(runs, key=lambda run: (run["seconds"], run["error"])):
        if not kept or one["error"] < kept[-1]["error"]:
            kept.append(one)
    return kept


def time_to(error: float, runs: list[dict[str, Any]]) -> float | None:
    """Least seconds to this error on a front, interpolated in logarithms; None where it is not reached."""
    best = front(runs)
    for before, after in zip([None, *best], best, strict=False):
        if after["error"] > error:
            continue
        if before is None:
            return after["seconds"]
        share = np.log(before["error"] / error) / np.log(before["error"] / after["error"])
        return float(before["seconds"] * (after["seconds"] / before["seconds"]) ** share)
    return None


def speedups(mine: list[dict[str, Any]], theirs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """At the error of each point of our front: the fastest alternative's seconds over ours.

    Where no alternative came as far, the ratio is a bound: that of the seconds of the most accurate one.
    """
    found: list[dict[str, Any]] = []
    best = front(theirs)[-1]
    for point in front(mine):
        needed = time_to(point["error"], theirs)
        found.append(
            {key: point[key] for key in ("size", "error", "seconds")}
            | {"reached": needed is not None, "ratio": (needed or best["seconds"]) / point["seconds"]}
            | ({} if needed else {"best_error_of_alternatives": best["error"]})
        )
    return found


def error_ratio(mine: list[dict[str, Any]], cubes: list[dict[str, Any]]) -> float | None:
    """Median over our points of our error over that of marching cubes at the same number of vertices."""
    counts, errors = (np.log([run[key] for run in sorted(cubes, key=lambda r: r["vertices"])])
                      for key in ("vertices", "error"))  # fmt: skip
    within = [run for run in mine if counts[0] <= np.log(run["vertices"]) <= counts[-1]]
    if not within:
        return None
    ratios = [run["error"] / np.exp(np.interp(np.log(run["vertices"]), counts, errors)) for run in within]
    return float(np.median(ratios))


def summarise(results: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures that issue 3 asks for, by shape and task."""
    shapes: dict[str, Any] = {}
    for result in results:
        shapes[result["shape"]] = {
            key: result[key] for key in ("neural", "asset_bytes", "base_faces", "reference") if key in result
        }
        for task in TASKS:
            mine, theirs = points(result, task, True), points(result, task, False)
            cubes = [run for run in theirs if run["method"] == "marching cubes"]
            shapes[result["shape"]][task] = {
                "error_ratio_to_marching_cubes_at_equal_vertices": error_ratio(mine, cubes),
                "dominated": dominated(mine, theirs),
                "at_equal_error": speedups(mine, theirs),
            }
    medians = {
        task: float(np.median([value for shape in shapes.values()
                               if (value := shape[task]["error_ratio_to_marching_cubes_at_equal_vertices"])]))
        for task in TASKS
    }  # fmt: skip
    return {"median_error_ratio_to_marching_cubes_at_equal_vertices": medians, "shapes": shapes}


def draw(result: dict[str, Any], path: Path) -> None:
    """Error against seconds, one panel for each task, one line for each method."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter

    figure, axes = plt.subplots(1, 2, figsize=(11, 4.6))
    for axis, task in zip(axes, TASKS, strict=True):
        runs = points(result, task)
        for method in dict.fromkeys(run["method"] for run in runs):
            line = [run for run in runs if run["method"] == method]
            bold = method == "ours"
            axis.loglog([run["seconds"] for run in line], [run["error"] for run in line], "o-" if bold else ".-",
                        lw=2.2 if bold else 1, color="black" if bold else None, label=method)  # fmt: skip
        moved = [
            (total(entry, task), entry["vertices_on_surface"][f"{task}_error"])
            for entry in result["runs"]
            if entry["method"] == "ours" and f"{task}_error" in entry["vertices_on_surface"]
        ]
        style = {"color": "gray", "lw": 1.2, "label": "ours, vertices on the true surface"}
        axis.loglog([x for x, _ in moved], [y for _, y in moved], ":", **style)
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel("CPU seconds, extraction and solution")
        axis.set_ylabel(
            f"relative error, {'exact geodesics (L1)' if task == 'geodesics' else '20 eigenvalues (mean)'}"
        )
        axis.grid(True, which="major", lw=0.3)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="lower center", ncols=4, fontsize=8)
    kind = "neural implicit" if result["neural"] else "mesh as a signed distance"
    figure.suptitle(f"{result['shape']} ({kind}; asset of {result['asset_bytes'] / 1000:.0f} KB)")
    figure.tight_layout(rect=(0, 0.09, 1, 1))
    figure.savefig(path, dpi=120)
    plt.close(figure)
