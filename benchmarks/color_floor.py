"""How well can any function of the surface point give the colours of opaque splats?

    python benchmarks/color_floor.py [NAME ...]

Two bounds for a learned field, as mean errors over the channels at the centres of the opaque splats:

- `left_out`: each splat against the median of its k nearest others. What a function that has not seen the splat can
  say, for the best amount of smoothing.
- `cells`: centres cut into cells of about k by halving the longest side again and again, each cell with the median of
  its own splats. A function that has seen all of them, and `numbers` are what it has to store.

Both also with every splat weighed by its opacity times its area: a picture shows large splats, not small ones.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from ndf_plugin_gaussians.readers.splat_file import read_splat_file
from numpy import ndarray as Array
from scipy.spatial import KDTree

import ndf_core

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / "shared" / "data" / "splat"
RESULTS = HERE / "results" / "color_floor.json"
STATUES = ("statue_angel", "statue_massa", "statue_angel-kneeling", "statue_st-peter")
NEIGHBOURS = (4, 8, 16, 32, 64)


def floor(path: Path) -> dict[str, Any]:
    """The bounds for one file; the colours are those that `ndf fit --colors` learns."""
    surface = ndf_core.open(path)
    assert surface.colors is not None
    colored = surface.colors()
    assert colored is not None
    points, colors = colored.points, np.asarray(colored.colors, dtype=np.float64)
    weights = shown(path, points)
    near = np.asarray(KDTree(points).query(points, k=max(NEIGHBOURS) + 1)[1])[:, 1:]
    found: dict[str, Any] = {"opaque": len(points)}
    for k in NEIGHBOURS:
        off = np.abs(np.median(colors[near[:, :k]], axis=1) - colors).mean(axis=1)
        kept, count = np.zeros(len(points)), 0
        for rows in cells(points, k):
            kept[rows] = np.abs(np.median(colors[rows], axis=0) - colors[rows]).mean(axis=1)
            count += 1
        found[f"k={k}"] = {
            "left_out": float(off.mean()),
            "left_out_weighted": float(np.average(off, weights=weights)),
            "cells": float(kept.mean()),
            "cells_weighted": float(np.average(kept, weights=weights)),
            "numbers": 3 * count,
        }
    return found


def shown(path: Path, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Opacity times area (of the two longer axes) of the splats at these centres."""
    splats = read_splat_file(path)[0]
    distance, row = KDTree(splats.centres).query(points)
    assert float(np.max(distance)) < 1e-6 * np.ptp(points), "the colours are given at centres of splats"
    axes = np.sort(splats.scales[row], axis=1)
    return splats.opacities[row] * axes[:, 1] * axes[:, 2]


def cells(points: Float[Array, "n 3"], size: int) -> Iterator[Int[Array, " m"]]:
    """Rows of each cell: halved across the longest side until no more than 4/3 of `size` are left."""
    waiting = [np.arange(len(points))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= size * 4 / 3:
            yield rows
            continue
        axis = int(np.argmax(np.ptp(points[rows], axis=0)))
        rows = rows[np.argsort(points[rows, axis])]
        waiting += [rows[: len(rows) // 2], rows[len(rows) // 2 :]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(STATUES), metavar="NAME")
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name in parser.parse_args().names:
        results[name] = floor(DATA / f"{name}.sog")
        print(name, json.dumps(results[name]))
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
