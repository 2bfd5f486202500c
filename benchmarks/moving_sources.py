"""Milliseconds until a moved source is answered, after one factorisation: heat flow and heat-method distances.

    python benchmarks/moving_sources.py ASSET [--vertices 50000]

The time is from the point in space to the values on all vertices, the closest point included. Median CPU time of one
thread over 40 places.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.asset.asset import Asset
from ndf_core.processing.heat_flow import HeatFlow
from ndf_core.processing.heat_method import heat_distances
from ndf_core.processing.operators import Operators

PLACES = 40
RESULTS = Path(__file__).resolve().parent / "results" / "moving_sources.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path)
    parser.add_argument("--vertices", type=int, default=50_000, help="about")
    options = parser.parse_args()
    asset = Asset.load(options.asset)
    coarse = asset.extract(asset.longest_side / 60)
    edge = coarse.edge_length * (len(coarse.vertices) / options.vertices) ** 0.5
    mesh = asset.extract(edge)
    operators = Operators.of(mesh)
    start = time.process_time()
    flow = HeatFlow(operators, 100 * operators.mean_edge_length**2)
    places = mesh.vertices[np.linspace(0, len(mesh.vertices) - 1, PLACES).astype(int)]
    heat_distances(operators, operators.closest(places[:1]))
    found = {
        "asset": options.asset.stem,
        "vertices": len(mesh.vertices),
        "factorise_seconds": time.process_time() - start,
        "heat_milliseconds": median(lambda place: flow.advance(operators.closest(place)), places),
        "geodesics_milliseconds": median(lambda place: heat_distances(operators, operators.closest(place)), places),
    }
    RESULTS.write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found))


def median(answer: Callable[[Float[Array, "1 3"]], object], places: Float[Array, "n 3"]) -> float:
    """Milliseconds of CPU time."""
    seconds: list[float] = []
    for place in places:
        start = time.process_time()
        answer(place[None])
        seconds.append(time.process_time() - start)
    return 1e3 * float(np.median(seconds))


if __name__ == "__main__":
    main()
