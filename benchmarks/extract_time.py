"""Seconds of `ndf extract` in a new process, start of Python and writing included, against the budget of 0.7 s and 10
microseconds per vertex; and the first time after an installation (nothing compiled to bytecode yet) against 3 s.

Without an asset, one is made with random weights of the default size over a torus of 2,000 faces. CPU seconds are
given beside wall seconds: other processes hardly lengthen them.

    python benchmarks/extract_time.py [ASSET.ndf] [--runs 5] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
COMMAND = "from ndf_core.cli import main; main()"


def made_asset(folder: Path) -> Path:
    """Untrained, but smooth: weights of the higher levels fall off."""
    sys.path.insert(0, str(HERE.parent / "tests" / "helpers"))
    from small_assets import small_content, torus

    from ndf_core.asset.asset import Asset

    content = small_content(torus(50, 20), feature_dim=16, width=64, levels=4, amplitude=0.03)
    Asset(content).save(folder / "made.ndf")
    return folder / "made.ndf"


def run(asset: Path, output: Path, **environment: str) -> dict[str, Any]:
    before, start = os.times(), time.perf_counter()
    command = [sys.executable, "-c", COMMAND, "extract", str(asset), "-o", str(output), "--json"]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=True)
    wall, after = time.perf_counter() - start, os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return {"wall": wall, "cpu": cpu, "vertices": json.loads(done.stdout)["vertices"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path, nargs="?")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--output", type=Path, default=HERE / "results" / "extract_time.json")
    options = parser.parse_args()
    result: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        asset = options.asset or made_asset(Path(folder))
        first = run(asset, Path(folder) / "first.ply", PYTHONPYCACHEPREFIX=str(Path(folder) / "bytecode"))
        result["first"] = {"wall": first["wall"], "cpu": first["cpu"], "budget": 3.0}
        for suffix in ("ply", "obj"):
            runs = [run(asset, Path(folder) / f"mesh.{suffix}") for _ in range(options.runs)]
            vertices = runs[0]["vertices"]
            best = {key: min(one[key] for one in runs) for key in ("wall", "cpu")}
            result[suffix] = {"vertices": vertices, **best, "budget": 0.7 + 1e-5 * vertices}
    text = json.dumps(result, indent=1)
    options.output.parent.mkdir(exist_ok=True)
    options.output.write_text(text + "\n")
    print(text)


if __name__ == "__main__":
    main()
