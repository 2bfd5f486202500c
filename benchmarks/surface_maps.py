"""Do base meshes of a torus and a sphere go onto rocker-arm and spot without folds (App. D.1, `fig:same-topology`)?

    python benchmarks/surface_maps.py [rocker-arm] [spot]

Fits the analytic shape, then its base mesh onto the mesh with the pairs in `anchors/`. How far anchors end from their
targets, as shares of the longest side; folded area of the field (against the surface's normals) and of the extracted
mesh (faces that a neighbour is folded over).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import ndf_core
from ndf_core.config.fit import FitConfig
from ndf_core.config.resolve import Given, resolve_config
from ndf_core.fitting.pipeline import run_fit

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / "shared" / "data" / "mesh"
RESULTS = HERE / "results" / "surface_maps.json"
SHAPES = {
    "rocker-arm": ("torus", 'type = "torus"\nmajor_radius = 1.0\nminor_radius = 0.4\naxis = [1.0, 0.0, 0.0]\n', 1600),
    "spot": ("sphere", 'type = "sphere"\nradius = 1.0\n', 1600),
}


def measured(shape: str, folder: Path) -> dict[str, Any]:
    name, tree, steps = SHAPES[shape]
    (folder / f"{name}.toml").write_text(tree)
    base = folder / f"{name}.ndf"
    ndf_core.fit(ndf_core.open(folder / f"{name}.toml"), output=base, faces=4000, steps=300, threads=1)
    surface = ndf_core.open(DATA / f"{shape}.obj")
    given = {"base_from": str(base), "anchors": str(HERE / "anchors" / f"{name}_{shape}.csv"), "steps": steps}
    config: FitConfig = resolve_config(
        given=Given({**given, "threads": 1}), training_defaults=surface.training_defaults
    ).fit.config
    start = time.process_time()
    result = run_fit(surface, config)
    seconds = time.process_time() - start
    mesh = result.asset.extract()
    return {
        "anchors": result.report["anchors"],
        "folded_area_field": result.report["error"]["folded_area"],
        "folded_area_mesh": mesh.statistics["folded_area"],
        "field_to_surface_rms": result.report["error"]["field_to_surface"]["rms"],
        "surface_to_field_rms": result.report["error"]["surface_to_field"]["rms"],
        "bytes": result.asset.size,
        "steps": steps,
        "seconds": seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shapes", nargs="*", default=list(SHAPES))
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for shape in parser.parse_args().shapes:
        with tempfile.TemporaryDirectory() as folder:
            results[shape] = measured(shape, Path(folder))
        print(shape, json.dumps(results[shape]), file=sys.stderr, flush=True)
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
