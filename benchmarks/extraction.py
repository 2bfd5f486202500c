"""Error of geodesics and eigenvalues against the client's time (`fig:neus-client`, App. B.1 and B.2).

For an asset and the surface that it was fitted to: meshes extracted from the asset, and meshes that a client makes
of the surface itself by marching cubes in a narrow band, alone, with an intrinsic Delaunay triangulation, and with
isotropic remeshing (Botsch-Kobbelt by gpytoolbox, PyMeshLab's). All meshes get the same two tasks from the same code.
Time is CPU seconds of one thread: extraction, with all queries of the field, and solution. Fits are not part of it.

Also, for the asset's meshes: the errors once their vertices are put onto the true surface, which tells the field's
part of the error from the mesh's.

    OMP_NUM_THREADS=1 python benchmarks/extraction.py --assets DIR [--shapes rocker-arm ...] [--faces 8000]
    python benchmarks/extraction.py --summary-only
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from extraction_methods import Meshed, ours, plain, remeshed
from extraction_shapes import Reference, Shape, open_shape, reference_of
from extraction_summary import draw, summarise
from extraction_tasks import EIGENVALUES, AsMeshed, exact_geodesics, geodesic_error, spectrum_error, timed
from numpy import ndarray as Array

from ndf_core.asset.asset import Asset
from ndf_core.errors import InputError
from ndf_core.processing.operators import Operators
from ndf_core.processing.spectrum import laplace_spectrum

HERE = Path(__file__).parent
RESULTS = HERE / "results"
MOST_FACES_GEODESICS, MOST_FACES_SPECTRUM = 80_000, 250_000
"""Larger meshes take longer than the window of times that matters."""
MOST_FACES_ON_SURFACE = 25_000
SHAPES = {
    "niq_bunny": "neural/niq_bunny.npz",
    "niq_fox": "neural/niq_fox.npz",
    "rocker-arm": "mesh/rocker-arm.obj",
    "spot": "mesh/spot.obj",
    "horse": "mesh/horse.ply",
    "nefertiti": "mesh/nefertiti.obj",
}


def measure(
    meshed: Meshed, reference: Reference, kind: type[Operators], most_faces: int = MOST_FACES_GEODESICS
) -> dict[str, Any]:
    """Both tasks on one mesh. Distances do not depend on the triangulation of the surface, eigenvalues do."""
    entry: dict[str, Any] = {
        "method": meshed.method,
        "size": meshed.size,
        "vertices": len(meshed.vertices),
        "faces": len(meshed.faces),
        "seconds": {"extract": meshed.seconds},
    }

    def solve() -> tuple[Array, Operators]:
        fresh = kind(meshed.vertices, meshed.faces, edge_lengths=meshed.edge_lengths)
        return laplace_spectrum(fresh, EIGENVALUES).eigenvalues, fresh

    (spectrum, operators), entry["seconds"]["spectrum"] = timed(solve)
    entry["spectrum_error"] = spectrum_error(spectrum, reference.eigenvalues)
    entry["area_error"] = operators.area / reference.area - 1
    if len(meshed.faces) <= most_faces:
        distances, entry["seconds"]["geodesics"] = timed(lambda: exact_geodesics(operators, reference.sources))
        entry["geodesics_error"], entry["seconds"]["query"] = geodesic_error(
            distances, reference.vertices, reference.weights, reference.distances
        )
    return entry


def with_delaunay(entry: dict[str, Any], meshed: Meshed, reference: Reference) -> dict[str, Any]:
    """The same mesh on its intrinsic Delaunay triangulation: the surface, and so its distances, stay."""
    _, flips = timed(lambda: Operators(meshed.vertices, meshed.faces).triangulation)
    changed = measure(meshed, reference, Operators)
    changed["method"] = "marching cubes + intrinsic Delaunay"
    if "geodesics_error" in entry:
        changed["geodesics_error"] = entry["geodesics_error"]
        changed["seconds"] |= {key: entry["seconds"][key] for key in ("geodesics", "query")}
        changed["seconds"]["geodesics"] += flips
    return changed


def on_surface(entry: dict[str, Any], meshed: Meshed, shape: Shape, reference: Reference) -> dict[str, float]:
    """Errors of the same triangles with their vertices on the true surface."""
    moved = Meshed(meshed.method, meshed.size, shape.project(meshed.vertices), meshed.faces, 0.0)
    change = np.linalg.norm(moved.vertices - meshed.vertices, axis=1)
    found = measure(moved, reference, Operators, MOST_FACES_ON_SURFACE)
    return {
        "vertex_error_rms": float(np.sqrt((change**2).mean())),
        **{key: found[key] for key in ("spectrum_error", "geodesics_error", "area_error") if key in found},
    }


def run(shape: Shape, results: Path, kept: list[dict[str, Any]]) -> None:
    """Everything, or the asset's meshes beside `kept` runs of the alternatives; written after every mesh."""
    reference = reference_of(shape)
    print(f"{shape.name}: reference {reference.facts}", flush=True)
    entries = list(kept)
    result = {
        "shape": shape.name,
        "neural": shape.neural,
        "asset_bytes": shape.asset.stat().st_size,
        "base_faces": len(Asset.load(shape.asset).content.faces),
        "reference": reference.facts,
        "runs": entries,
    }

    def add(entry: dict[str, Any]) -> None:
        entries.append(entry)
        results.write_text(json.dumps(result, indent=1) + "\n")
        shown = {key: entry[key] for key in ("geodesics_error", "spectrum_error") if key in entry}
        print(f"  {entry['method']} {entry['size']:g} {entry['vertices']:,}", shown, entry["seconds"], flush=True)

    for meshed in ours(shape):
        if len(meshed.faces) > MOST_FACES_SPECTRUM:
            break
        entry = measure(meshed, reference, Operators)
        add(entry | {"vertices_on_surface": on_surface(entry, meshed, shape, reference)})
    for meshed in [] if kept else plain(shape):
        if len(meshed.faces) > MOST_FACES_SPECTRUM:
            break
        entry = measure(meshed, reference, AsMeshed)
        add(entry)
        add(with_delaunay(entry, meshed, reference))
    for name in () if kept else ("Botsch-Kobbelt", "PyMeshLab"):
        for meshed in remeshed(shape, name):
            try:
                add(measure(meshed, reference, Operators))
            except InputError as error:
                add({"method": meshed.method, "size": meshed.size, "vertices": len(meshed.vertices),
                     "seconds": {}, "failed": str(error)})  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", type=Path, nargs="+", help="folders with <shape>_<faces>.ndf")
    parser.add_argument("--faces", type=int, nargs="+", default=[8000], help="of the base mesh; the first there is")
    parser.add_argument("--shapes", nargs="+", default=list(SHAPES), choices=list(SHAPES))
    parser.add_argument("--data", type=Path, default=HERE.parent.parent / "shared" / "data")
    parser.add_argument("--only-ours", action="store_true", help="keep the alternatives' last runs")
    parser.add_argument("--summary-only", action="store_true", help="from the results that are there")
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    options.results.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    for name in [] if options.summary_only else options.shapes:
        path = options.results / f"extraction_{name}.json"
        candidates = [folder / f"{name}_{faces}.ndf" for faces in options.faces for folder in options.assets or []]
        asset = next((candidate for candidate in candidates if candidate.exists()), None)
        if asset is None:
            raise SystemExit(f"no asset {name}_{options.faces[0]}.ndf: fit it, and name its folder with --assets")
        start = time.perf_counter()
        kept = json.loads(path.read_text())["runs"] if options.only_ours else []
        others = [entry for entry in kept if entry["method"] != "ours"]
        run(open_shape(options.data / SHAPES[name], asset), path, others)
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    paths = [options.results / f"extraction_{name}.json" for name in SHAPES]
    found = [json.loads(path.read_text()) for path in paths if path.exists()]
    for result in found:
        draw(result, options.results / f"extraction_{result['shape']}.png")
    summary = summarise(found)
    (options.results / "extraction.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(json.dumps(summary, indent=1))


if __name__ == "__main__":
    main()
