"""Do base meshes of a torus and a sphere go onto other shapes without folds (App. D.1, `fig:same-topology`)?

    python benchmarks/surface_maps.py [NAME ...] [--pictures FOLDER]

Fits the analytic shape, then its base mesh onto the mesh with the pairs in `anchors/`: a torus onto rocker-arm from
four base meshes, and a sphere onto spot; with pairs that nobody chose (twelve extremities to their directions from
the middle), a sphere onto cheburashka, homer and horse, whose limbs are too slender for closest points. How far
anchors end from their targets, as shares of the longest side; folded area of the field (against the surface's
normals) and of the extracted mesh (faces that a neighbour is folded over). A picture shows a texture of the analytic
shape on both.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.asset.dense_map import dense_map
from ndf_core.config.fit import FitConfig
from ndf_core.config.resolve import Given, resolve_config
from ndf_core.fitting.pipeline import run_fit
from ndf_core.render import panels, render_mesh, write_png

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / "shared" / "data" / "mesh"
RESULTS = HERE / "results" / "surface_maps.json"
STEPS = 1600
TORUS = 'type = "torus"\nmajor_radius = 1.0\nminor_radius = 0.4\naxis = [1.0, 0.0, 0.0]\n'
SPHERE = 'type = "sphere"\nradius = 1.0\n'
TEXTURED = 300_000
"""Triangles of a picture."""


class Case(NamedTuple):
    """A base shape, how it is fitted, and where its base mesh goes."""

    source: str
    tree: str
    target: str
    fit: dict[str, int]


CASES = {
    "rocker-arm": Case("torus", TORUS, "rocker-arm.obj", {"faces": 4000}),
    "rocker-arm, seed 1": Case("torus", TORUS, "rocker-arm.obj", {"faces": 4000, "seed": 1}),
    "rocker-arm, 3,000 faces": Case("torus", TORUS, "rocker-arm.obj", {"faces": 3000}),
    "rocker-arm, 6,000 faces": Case("torus", TORUS, "rocker-arm.obj", {"faces": 6000}),
    "spot": Case("sphere", SPHERE, "spot.obj", {"faces": 4000}),
    "cheburashka": Case("sphere", SPHERE, "cheburashka.obj", {"faces": 4000}),
    "homer": Case("sphere", SPHERE, "homer.obj", {"faces": 4000}),
    "horse": Case("sphere", SPHERE, "horse.ply", {"faces": 4000}),
}


def measured(case: Case, folder: Path, picture: Path | None) -> dict[str, Any]:
    tree, base = folder / "tree.toml", folder / "base.ndf"
    tree.write_text(case.tree)
    ndf_core.fit(ndf_core.open(tree), output=base, steps=300, threads=1, **case.fit)
    pairs = HERE / "anchors" / f"{case.source}_{Path(case.target).stem}.csv"
    surface = ndf_core.open(DATA / case.target)
    given = {"base_from": str(base), "anchors": str(pairs), "steps": STEPS, "threads": 1}
    config: FitConfig = resolve_config(given=Given(given), training_defaults=surface.training_defaults).fit.config
    start = time.process_time()
    result = run_fit(surface, config)
    seconds = time.process_time() - start
    if picture is not None:
        write_png(picture, textured(Asset.load(base), result.asset, case))
    error = result.report["error"]
    return {
        "anchors": result.report["anchors"],
        "folded_area_field": error["folded_area"],
        "folded_area_mesh": result.asset.extract().statistics["folded_area"],
        "field_to_surface_rms": error["field_to_surface"]["rms"],
        "surface_to_field_rms": error["surface_to_field"]["rms"],
        "bytes": result.asset.size,
        "steps": STEPS,
        "seconds": seconds,
    }


def textured(source: Asset, target: Asset, case: Case) -> UInt8[Array, "h w 3"]:
    """Base shape and target from two sides each, in colours that belong to base points."""
    images: list[UInt8[Array, "h w 3"]] = []
    for asset in (source, target):
        dense = dense_map(len(asset.content.faces), asset.evaluate, TEXTURED)
        middle = np.full((len(dense.triangles), 3), 1 / 3)
        faces, weights = dense.base_points(np.arange(len(dense.triangles)), middle)
        colors = texture(source.map_points(faces, weights), case.source)
        for view in ((30.0, 15.0), (205.0, -20.0)):
            images.append(
                render_mesh(dense.vertices, dense.triangles, width=480, height=480, view=view, colors=colors)
            )
    return panels(images, ["", "", "", ""], columns=4)


def texture(points: Float[Array, "n 3"], source: str) -> Float[Array, "n 3"]:
    """A chequered pattern around the x axis and, on a torus, around its tube."""
    around = np.arctan2(points[:, 2], points[:, 1])
    ring = np.hypot(points[:, 1], points[:, 2]) - (1.0 if source == "torus" else 0.0)
    along = np.arctan2(points[:, 0], ring)
    even = (np.floor(around / np.pi * 12) + np.floor(along / np.pi * 6)) % 2
    hue = np.column_stack([0.5 + 0.5 * np.cos(around), 0.5 + 0.5 * np.cos(along), 0.5 + 0.5 * np.sin(around)])
    return hue * (0.5 + 0.5 * even[:, None])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=list(CASES), metavar="NAME", help=", ".join(CASES))
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each")
    options = parser.parse_args()
    for name in options.names:
        if options.pictures:
            options.pictures.mkdir(parents=True, exist_ok=True)
        picture = options.pictures / f"{name}.png" if options.pictures else None
        with tempfile.TemporaryDirectory() as folder:
            found = measured(CASES[name], Path(folder), picture)
        print(name, json.dumps(found), file=sys.stderr, flush=True)
        results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
        results[name] = found
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
