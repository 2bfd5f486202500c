"""Does `ndf fit`, then `ndf extract`, work on every file, how long does it take, and how good is what comes out?

Both commands run in processes of their own with a time limit, with the defaults but for 4,000 base faces. A row says

- what `ndf fit --json` reports: representation, seconds (of the clock and of the processor, everything included),
  share of the samples in training that could be projected, mean and rms distance in both directions as shares of the
  longest side (none backwards where the surface cannot be sampled);
- what the extracted mesh is: manifold, closed, genus and components counted on its triangles, folded area;
- bytes of the asset; or the message of the error that ended either command.

Files that have a row are not run again (`--again` does). `--pictures` writes a PNG of input beside mesh for each.

    python benchmarks/representations.py [FILE ...] --assets FOLDER [--pictures FOLDER] [--table]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.files import atomic_write
from ndf_core.mesh import topology
from ndf_core.readers.mesh_file import read_mesh_file

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / "shared" / "data"
FOLDERS = ("neural", "grid", "splat", "nerf", "soup", "pointcloud", "mesh")
NO_SURFACE = ("neural/thingi_95444_empty.h5", "nerf/krrish_fern.ckpt")
"""No zero level set; no closed object. Refusing these is right, as MANIFEST.md says."""
ISO_VALUES = {"grid/spm152.nii.gz": 22, "grid/CT_AVM.nii.gz": 230}
"""As MANIFEST.md gives them."""
COLUMNS = (
    "representation", "file", "CPU s", "wall s", "converged", "field to surface: mean, rms",
    "surface to field: mean, rms", "manifold, closed", "genus, components", "folded area", "bytes",
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A finished command."""

    status: int | None
    """Exit status; None when its time was over."""
    output: str
    errors: str
    wall: float
    cpu: float
    """Seconds of the processor, of all its threads."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--assets", type=Path, default=Path("representation_assets"))
    parser.add_argument("--pictures", type=Path, help="folder of PNGs, input beside mesh")
    parser.add_argument("--threads", type=int, default=0, help="of the fit; 0 for all, as by default")
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds of the clock that a command may take")
    parser.add_argument("--again", action="store_true", help="run files that have a row too")
    parser.add_argument("--table", action="store_true", help="print the table, run nothing")
    parser.add_argument("--output", type=Path, default=HERE / "results" / "representations.json")
    options = parser.parse_args()
    rows: dict[str, Any] = json.loads(options.output.read_text()) if options.output.is_file() else {}
    if options.table:
        print(table(rows))
        return
    options.assets.mkdir(parents=True, exist_ok=True)
    for path in options.files or inputs(options.data):
        name = f"{path.parent.name}/{path.name}"
        if name in rows and not options.again:
            continue
        row = measured(path, name, options.assets, options.threads, options.limit)
        # Another process may have written rows meanwhile.
        rows = json.loads(options.output.read_text()) if options.output.is_file() else {}
        rows[name] = row
        with atomic_write(options.output) as file:
            file.write(f"{json.dumps(dict(sorted(rows.items())), indent=1)}\n".encode())
        print(table({name: row}, header=False), flush=True)
        if options.pictures and "vertices" in row:
            draw(path, name, row["representation"], mesh_path(options.assets, name), options.pictures)


def inputs(data: Path) -> list[Path]:
    """Every input below a folder of data; descriptions beside networks (.yml) are none."""
    return [path for folder in FOLDERS for path in sorted((data / folder).iterdir()) if path.suffix != ".yml"]


def mesh_path(assets: Path, name: str) -> Path:
    return assets / f"{name.replace('/', '_')}.ply"


def measured(path: Path, name: str, assets: Path, threads: int, limit: float) -> dict[str, Any]:
    """Fit and extract one file."""
    mesh_file = mesh_path(assets, name)
    asset = mesh_file.with_suffix(".ndf")
    for old in (asset, mesh_file):
        old.unlink(missing_ok=True)
    words = ["fit", str(path), "-o", str(asset), "--faces", "4000", "--json", *iso_words(name)]
    fit = run([*words, *(["--threads", str(threads)] if threads else [])], limit)
    row: dict[str, Any] = {"threads": threads or os.cpu_count(), "wall": round(fit.wall, 1), "cpu": round(fit.cpu, 1)}
    if fit.status:
        return row | {"refused": refusal(fit), "expected": name in NO_SURFACE}
    if fit.status is None:
        return row | {"refused": f"fit: not done after {limit:g} s", "expected": False}
    row |= fit_figures(json.loads(fit.output))
    extract = run(["extract", str(asset), "-o", str(mesh_file), "--json"], limit)
    if extract.status != 0:
        return row | {"refused": f"extract: {refusal(extract)}", "expected": False}
    return row | {"extract_wall": round(extract.wall, 2)} | extract_figures(json.loads(extract.output), mesh_file)


def iso_words(name: str) -> list[str]:
    return ["--iso", str(ISO_VALUES[name])] if name in ISO_VALUES else []


def run(words: list[str], limit: float) -> Run:
    """Run `ndf` with these arguments."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "ndf_core", *words], capture_output=True, text=True, timeout=limit
        )
        status, output, errors = done.returncode, done.stdout, done.stderr
    except subprocess.TimeoutExpired:
        status, output, errors = None, "", ""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    return Run(status, output, errors, time.perf_counter() - start, cpu)


def refusal(run: Run) -> str:
    """The error's own text: what stderr ends with, from "error:" on."""
    start = run.errors.rfind("error:")
    text = " ".join(run.errors[start:].split()) if start >= 0 else run.errors[-400:]
    return text or f"exit status {run.status} without a message"


def fit_figures(report: dict[str, Any]) -> dict[str, Any]:
    error, base = report["error"], report["base_mesh"]
    backward = error["surface_to_field"]
    return {
        "representation": report["representation"],
        "stages": report["seconds"],
        "converged": report["converged"],
        "field_to_surface": {key: error["field_to_surface"][key] for key in ("mean", "rms", "p99")},
        "surface_to_field": backward and {key: backward[key] for key in ("mean", "rms", "p99")},
        "base_mesh": {key: base[key] for key in ("faces", "genus", "components")},
        "remarks": [remark["message"] for remark in base["remarks"]],
        "bytes": report["asset_bytes"],
    }


def extract_figures(report: dict[str, Any], mesh_file: Path) -> dict[str, Any]:
    mesh = read_mesh_file(mesh_file)
    counts = topology(mesh.faces.astype(np.int32), len(mesh.vertices))
    return {
        **{key: report[key] for key in ("vertices", "manifold", "closed", "folded_area", "self_intersections")},
        "genus": counts.genus,
        "components": counts.components,
    }


def table(rows: dict[str, Any], header: bool = True) -> str:
    """Rows in Markdown, in the order of the folders."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"] if header else []
    order = sorted(rows, key=lambda name: (FOLDERS.index(name.split("/")[0]), name))
    lines += [f"| {' | '.join(cells(name, rows[name]))} |" for name in order]
    return "\n".join(lines)


def cells(name: str, row: dict[str, Any]) -> list[str]:
    called = " ".join([name.split("/")[1], *iso_words(name)])
    first = [row.get("representation", "-"), called, f"{row['cpu']:.0f}", f"{row['wall']:.0f}"]
    if "refused" in row:
        return [*first, f"{'refused, as is right' if row['expected'] else '**refused**'}: {row['refused']}"]
    both = [row["field_to_surface"], row["surface_to_field"]]
    return [
        *first,
        f"{row['converged']:.4f}",
        *(f"{side['mean']:.1e}, {side['rms']:.1e}" if side else "-" for side in both),
        f"{'yes' if row['manifold'] else '**no**'}, {'yes' if row['closed'] else '**no**'}",
        f"{row['genus']}, {row['components']}",
        f"{row['folded_area']:.1e}",
        f"{row['bytes']:,}",
    ]


def draw(path: Path, name: str, representation: str, mesh_file: Path, folder: Path) -> None:
    """Write the PNG of one file."""
    from representation_pictures import picture

    from ndf_core.render.png import write_png

    folder.mkdir(parents=True, exist_ok=True)
    mesh = read_mesh_file(mesh_file)
    triangles: tuple[Float[Array, "v 3"], Int[Array, "f 3"]] = (mesh.vertices, mesh.faces.astype(np.int32))
    given = {"iso": ISO_VALUES[name]} if name in ISO_VALUES else {}
    write_png(folder / f"{mesh_file.stem}.png", picture(path, representation, given, triangles))


if __name__ == "__main__":
    main()
