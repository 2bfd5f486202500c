"""`ndf field eval`: a learned field on an extracted mesh, or at points."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ndf_core.cli.paths import check_output
from ndf_core.cli.processing import draw_surface, read_surface, surface_options
from ndf_core.cli.result import Result, as_lines
from ndf_core.errors import ConfigError

if TYPE_CHECKING:
    from numpy import ndarray as Array

_DRAWN = 8
_PICTURE_SIDE = 400


@click.command(short_help="Evaluate a field of an asset on an extracted mesh, or at points.")
@click.option("--name", required=True, help="Name of the field (ndf info lists them).")
@click.option(
    "--points",
    type=click.Path(path_type=Path),
    metavar="FILE.npz",
    help="Evaluate at the array `points` of this file, brought to the surface, instead of on a mesh; into an .npz.",
)
@surface_options
def command(
    source: Path, name: str, points: Path | None, output: Path, edge_length: float | None, picture: Path | None
) -> Result:
    """Evaluate a field of an asset on a mesh extracted from it, or at points near its surface."""
    if points is not None:
        return _at_points(source, name, points, output, edge_length, picture)
    from ndf_core.asset.asset import Asset

    start = time.perf_counter()
    asset = Asset.load(source)
    asset.evaluator(name)  # is it there? asked before the work
    mesh = read_surface(source, edge_length, output, picture)
    assert mesh.extracted is not None

    from ndf_core.processing.vertex_values import write_vertex_values
    from ndf_core.render import panels, write_png

    ready = time.perf_counter()
    found = asset.values(name, mesh.extracted.base_faces, mesh.extracted.barycentric, os.cpu_count() or 1)
    done = time.perf_counter()
    block = asset.content.fields[name]
    columns = found.reshape(len(found), -1)
    titles = [f"{name}_{i}" for i in range(columns.shape[1])] if columns.shape[1] > 1 else [name]
    colors = [_colors(columns[:, i]) for i in range(min(_DRAWN, columns.shape[1]))]
    true_colors = asset.colors(mesh.extracted.base_faces, mesh.extracted.barycentric) if name == "color" else None
    if true_colors is not None:
        colors = [true_colors / 255.0]
    values = {title: columns[:, i].astype(float) for i, title in enumerate(titles)}
    write_vertex_values(output, mesh, values, colors[0], {name: found})
    if picture is not None:
        images = [draw_surface(mesh, color, _PICTURE_SIDE) for color in colors]
        labels = block.labels if len(block.labels) == len(images) else titles
        write_png(picture, panels(images, list(labels[: len(images)]), columns=min(4, len(images))))
    report = {
        "field": name,
        "kind": block.kind,
        "vertices": len(mesh.vertices),
        "columns": columns.shape[1],
        "labels": block.labels,
        **_range(found),
        "seconds": {"read": ready - start, "evaluate": done - ready, "write": time.perf_counter() - done},
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")


def _at_points(
    source: Path, name: str, points: Path, output: Path, edge_length: float | None, picture: Path | None
) -> Result:
    if edge_length is not None or picture is not None:
        raise ConfigError("--points: there is no mesh to choose an edge length for, or to draw")
    check_output(output, (".npz",), points)

    from ndf_core.asset.asset import Asset
    from ndf_core.processing.field_points import evaluate_at_points

    report = evaluate_at_points(Asset.load(source), name, points, output, os.cpu_count() or 1)
    return Result(report, f"{output}\n{as_lines(report, '  ')}")


def _range(found: Array) -> dict[str, Any]:
    numbers = found.astype(float)
    return {"least": float(numbers.min(initial=float("inf"))), "largest": float(numbers.max(initial=float("-inf")))}


def _colors(values: Array) -> Array:
    """sRGB over the range of the values."""
    from ndf_core.render import colormap

    numbers = values.astype(float)
    low, high = float(numbers.min()), float(numbers.max())
    return colormap(numbers, low, high if high > low else low + 1.0, "turbo")
