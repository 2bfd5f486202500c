"""Bytes against error: assets beside the best of QEM + Draco, at equal bytes and at equal error.

The error is the larger of the two directions' rms distance, as a share of the longest side of the input for both. An
asset is counted as a client downloads it, without the inverse network; its size with it is given too. Every result is
cached in the JSON file and taken from there while the input and the options of the fit are the same, so a run can be
stopped and continued; `--refit` forgets the assets of the shapes named, which a change of the trainer needs.

    python benchmarks/rate_distortion.py --only qem-draco       # minutes, one thread
    python benchmarks/rate_distortion.py                        # the fits too
    python benchmarks/rate_distortion.py --only summary         # only the table and the figure
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from accuracy import measure_asset, option
from qem_draco import Point, Reference, bytes_at, lower_envelope, rms_at, sweep

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.config.fit import FitConfig
from ndf_core.config.resolve import Given, resolve_config
from ndf_core.errors import ConfigError, NdfError
from ndf_core.files import atomic_write
from ndf_core.fitting.pipeline import run_fit
from ndf_core.interfaces import Surface
from ndf_core.readers.mesh_file import read_mesh_file
from ndf_core.surfaces.closed_mesh import closed_mesh

HERE = Path(__file__).resolve().parent
SHAPES = ("rocker-arm.obj", "nefertiti.obj", "igea_tri.ply", "armadillo.obj", "sks_elephant_A.obj")
SIZES = ("500/8/32", "1000/8/32", "2000/8/32", "2000/8", "2000/16", "4000/8", "4000/16", "8000/8")
"""Base faces / feature dimension of the assets; a third number is the width of the hidden layers."""
_NOT_THE_ASSET = {"device", "threads", "checkpoint_seconds", "keep_inverse"}
"""Options that do not change what is measured here."""


@dataclass(frozen=True)
class Shape:
    """One input, read once for both sides."""

    name: str
    surface: Surface
    reference: Reference
    longest_side: float

    @classmethod
    def read(cls, path: Path, samples: int) -> Shape:
        mesh = closed_mesh(read_mesh_file(path), None, path.name)
        sides = mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)
        surface = ndf_core.open((mesh.vertices, mesh.faces), "mesh")
        return cls(path.stem, surface, Reference.of(mesh.vertices, mesh.faces, samples), float(sides.max()))


def fit_config(shape: Shape, size: str, options: dict[str, Any]) -> FitConfig:
    """The default recipe with this size, FACES/DIMENSION or FACES/DIMENSION/WIDTH; `options` as on the command line.

    Raises:
        ConfigError: of another form, or a number is out of bounds.
    """
    numbers = size.split("/")
    if not 2 <= len(numbers) <= 3:
        raise ConfigError(f"--sizes {size}: give FACES/DIMENSION or FACES/DIMENSION/WIDTH")
    named = dict(zip(("faces", "feature_dim", "hidden_width"), numbers, strict=False))
    given = Given({**options, **named, "keep_inverse": True}, name=f"size {size}")
    return resolve_config(given=given, training_defaults=shape.surface.training_defaults).fit.config


def fitted(shape: Shape, config: FitConfig) -> dict[str, Any]:
    """Fit one asset and measure it as written, against the longest side of the input."""
    result = run_fit(shape.surface, config)
    content = result.asset.content
    # The inverse is quantised after the displacement and apart from it: leaving it out changes nothing else.
    client = Asset(replace(content, fields={"displacement": content.fields["displacement"]}))
    figures = measure_asset(client, shape.surface, shape.reference.samples, threads=config.threads or 1)
    ratio = client.longest_side / shape.longest_side
    return {
        "bytes": client.size,
        "bytes_with_inverse": result.asset.size,
        "forward": _short(figures["field_to_surface"]["rms"] * ratio),
        "backward": _short(figures["surface_to_field"]["rms"] * ratio),
        "folded_area": figures["folded_area"],
        "opposed_area": figures["opposed_area"],
        "base_faces": figures["base_faces"],
        "seconds": result.report["seconds"]["total"],
        "config": identity(config),
    }


def identity(config: FitConfig) -> dict[str, Any]:
    """The options that a cached fit must agree with."""
    return config.model_dump(mode="json", exclude=_NOT_THE_ASSET)


def compare(name: str, entry: dict[str, Any]) -> list[dict[str, Any]]:
    """One row per asset: what QEM + Draco reaches with its bytes, and needs for its error."""
    envelope = lower_envelope(_points(entry))
    rows: list[dict[str, Any]] = []
    for size, asset in entry["ndf"].items():
        rms = max(asset["forward"], asset["backward"])
        theirs, needed = rms_at(envelope, asset["bytes"]), bytes_at(envelope, rms)
        rows.append(
            {
                "shape": name,
                "asset": size,
                "bytes": asset["bytes"],
                "bytes_with_inverse": asset["bytes_with_inverse"],
                "rms": rms,
                "qem_draco_rms_at_these_bytes": theirs and _short(theirs),
                "error_ratio": theirs and _short(rms / theirs),
                "qem_draco_bytes_at_this_rms": needed and round(needed),
                "bytes_ratio": needed and _short(asset["bytes"] / needed),
            }
        )
    return sorted(rows, key=lambda row: row["bytes"])


def table(rows: list[dict[str, Any]]) -> str:
    """For people; ratios below 1 are in favour of the asset."""
    head = f"{'shape':16}{'faces/d':>10}{'bytes':>9}{'+inverse':>9}{'rms':>11}{'QEM+Draco':>11}{'ratio':>7}"
    lines = [f"{head}{'bytes there':>13}{'ratio':>7}"]
    for row in rows:
        theirs, needed = row["qem_draco_rms_at_these_bytes"], row["qem_draco_bytes_at_this_rms"]
        lines.append(
            f"{row['shape']:16}{row['asset']:>10}{row['bytes']:9,}{row['bytes_with_inverse']:9,}{row['rms']:11.3e}"
            + (f"{theirs:11.3e}{row['error_ratio']:7.2f}" if theirs else f"{'-':>11}{'-':>7}")
            + (f"{needed:13,}{row['bytes_ratio']:7.2f}" if needed else f"{'-':>13}{'-':>7}")
        )
    return "\n".join(lines)


def figure(results: dict[str, Any], path: Path) -> None:
    """Error over bytes, both logarithmic, one panel per shape."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import StrMethodFormatter

    shapes = results["shapes"]
    columns = min(3, len(shapes))
    rows = -(-len(shapes) // columns)
    _, axes = plt.subplots(rows, columns, figsize=(4.8 * columns, 4.0 * rows), squeeze=False)
    for axis, (name, entry) in zip(axes.flat, shapes.items(), strict=False):
        points, best = _points(entry), lower_envelope(_points(entry))
        axis.loglog([p.bytes for p in points], [p.rms for p in points], ".", ms=2.5, color="0.75", zorder=1)
        axis.loglog([p.bytes for p in best], [p.rms for p in best], "-", color="0.25", label="QEM + Draco, envelope")
        sizes = sorted(entry["ndf"].items(), key=lambda item: item[1]["bytes"])
        rms = [max(asset["forward"], asset["backward"]) for _, asset in sizes]
        if sizes:
            axis.loglog([a["bytes"] for _, a in sizes], rms, "o", color="tab:blue", ms=5, label="asset")
            inverse = [a["bytes_with_inverse"] for _, a in sizes]
            axis.loglog(inverse, rms, "o", mfc="none", color="tab:blue", ms=4, label="... with the inverse network")
        for (size, asset), error in zip(sizes, rms, strict=True):
            axis.annotate(size, (asset["bytes"], error), (-4, -9), textcoords="offset points", fontsize=6, ha="right")
        axis.set_title(f"{name}, {entry['faces']:,} faces", fontsize=10)
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
        axis.grid(which="both", color="0.93", lw=0.5)
        axis.set_xlabel("bytes of the file")
        axis.set_ylabel("two-sided rms / longest side")
    for axis in axes.flat[len(shapes) :]:
        axis.axis("off")
    axes[0][0].legend(fontsize=8, loc="lower left")
    plt.tight_layout()
    plt.savefig(path, dpi=100)
    plt.close()


def _points(entry: dict[str, Any]) -> list[Point]:
    return [Point(name, *values) for name, values in entry["qem_draco"].items()]


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def encoded(value: Any, levels: int = 4, indent: str = "\n") -> str:
    """JSON in which the outer levels are spread over lines, one measurement a line, for readable differences."""
    if not levels or not value or not isinstance(value, dict | list):
        return json.dumps(value)
    inner = indent + " "
    if isinstance(value, list):
        return "[" + ",".join(inner + json.dumps(item) for item in value) + indent + "]"
    items = (f"{inner}{json.dumps(key)}: {encoded(item, levels - 1, inner)}" for key, item in value.items())
    return "{" + ",".join(items) + indent + "}"


def save(results: dict[str, Any], path: Path) -> None:
    """Write all of it at once, so that a stopped run leaves the file as it was."""
    with atomic_write(path) as file:
        file.write((encoded(results) + "\n").encode())


def entry_of(results: dict[str, Any], shape: Shape) -> dict[str, Any]:
    """What is known of a shape; nothing where the input or the number of samples is another one."""
    head = {
        "input": shape.surface.fingerprint,
        "faces": len(shape.reference.faces),
        "samples": shape.reference.samples,
    }
    known = results["shapes"].get(shape.name, {})
    if any(known.get(key) != value for key, value in head.items()):
        results["shapes"][shape.name] = {**head, "qem_draco": {}, "ndf": {}}
    return results["shapes"][shape.name]


def run_baseline(shape: Shape, entry: dict[str, Any], keep: Callable[[], None]) -> None:
    for points in sweep(shape.reference, entry["qem_draco"]):
        entry["qem_draco"].update({p.name: [p.bytes, p.forward, p.backward] for p in points})
        keep()
        print(f"{shape.name}: {points[0].name} ... {len(entry['qem_draco'])} points", file=sys.stderr)


def run_fits(
    shape: Shape, entry: dict[str, Any], sizes: Sequence[str], options: dict[str, Any], keep: Callable[[], None]
) -> None:
    for size in sizes:
        config = fit_config(shape, size, options)
        if entry["ndf"].get(size, {}).get("config") == identity(config):
            continue
        entry["ndf"][size] = fitted(shape, config)
        keep()
        print(f"{shape.name}: asset {size} {entry['ndf'][size]['seconds']:.1f} s", file=sys.stderr)


def run(arguments: argparse.Namespace) -> None:
    results: dict[str, Any] = {"shapes": {}}
    if arguments.output.exists():
        results = json.loads(arguments.output.read_text())
    options = dict(map(option, arguments.set))

    def keep() -> None:
        save(results, arguments.output)

    for name in arguments.shapes if arguments.only != "summary" else ():
        shape = Shape.read(arguments.data / "mesh" / name, arguments.samples)
        entry = entry_of(results, shape)
        if arguments.only != "ndf":
            run_baseline(shape, entry, keep)
        if arguments.refit:
            entry["ndf"].clear()
        if arguments.only != "qem-draco":
            run_fits(shape, entry, arguments.sizes, options, keep)
    results["summary"] = [row for name, entry in results["shapes"].items() for row in compare(name, entry)]
    keep()
    figure(results, arguments.output.with_suffix(".png"))
    print(table(results["summary"]))


def main(given: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=HERE.parent / ".." / "shared" / "data", help="folder with mesh/")
    parser.add_argument("--shapes", nargs="+", default=SHAPES)
    parser.add_argument("--sizes", nargs="+", default=SIZES, metavar="FACES/DIMENSION[/WIDTH]")
    parser.add_argument("--only", choices=("qem-draco", "ndf", "summary"))
    parser.add_argument("--refit", action="store_true", help="forget the cached assets of these shapes")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="options of the fit, threads=1 say")
    parser.add_argument("--samples", type=int, default=100_000, help="in each direction")
    parser.add_argument("--output", type=Path, default=HERE / "results" / "rate_distortion.json")
    try:
        run(parser.parse_args(given))
    except NdfError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
