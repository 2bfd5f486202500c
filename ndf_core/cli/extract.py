"""`ndf extract`: from an asset to a triangle mesh."""

from __future__ import annotations

import math
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.paths import check_output
from ndf_core.cli.result import Result, as_lines
from ndf_core.errors import ConfigError

if TYPE_CHECKING:
    from numpy import ndarray as Array

    from ndf_core.extract.extracted import ExtractedMesh


@click.command(short_help="Extract a triangle mesh from an asset.")
@click.argument("asset", metavar="ASSET.ndf", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="The mesh: .ply, .obj, .stl, .glb, .off, or what a plugin writes.",
)
@click.option(
    "--edge-length", type=float, metavar="H", help="In the units of the input; 1/150 of the longest side if left out."
)
@json_option
@debug_option
def command(asset: Path, output: Path, edge_length: float | None) -> Result:
    """Extract a triangle mesh from ASSET.ndf, in the coordinates of the input that was fitted."""
    from ndf_core.asset.asset import Asset
    from ndf_core.meshio import SUFFIXES, write_mesh

    if edge_length is not None and not (math.isfinite(edge_length) and edge_length > 0):
        raise ConfigError(f"--edge-length {edge_length:g}: must be a positive length in the units of the input")
    exported = output.suffix.lower() not in SUFFIXES
    check_output(output, _with_plugins(SUFFIXES) if exported else SUFFIXES, asset)
    start = time.perf_counter()
    threads, loaded = os.cpu_count() or 1, Asset.load(asset)
    # A file holds flat triangles; an exporter plugin is given all there is.
    mesh = loaded.extract(edge_length, threads, measure_edges=exported)
    with ThreadPoolExecutor(1) as beside:
        counting = beside.submit(lambda: len(mesh.tree.self_intersections(threads=threads)))
        # An .stl holds none.
        plain = output.suffix.lower() == ".stl"
        colors = None if plain else loaded.colors(mesh.base_faces, mesh.barycentric, threads)
        if exported:
            _export(output, mesh, colors)
        else:
            write_mesh(output, mesh.vertices, mesh.faces, colors)
        statistics = {**mesh.statistics, "self_intersections": counting.result()}
    stages = statistics.pop("seconds")
    report = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "edge_length": mesh.edge_length,
        **statistics,
        "colored": colors is not None,
        "seconds": time.perf_counter() - start,  # reading and writing included
        "seconds_by_stage": stages,
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")


def _with_plugins(suffixes: tuple[str, ...]) -> tuple[str, ...]:
    from ndf_core.plugins.companions import exporter_suffixes

    return (*suffixes, *exporter_suffixes())


def _export(output: Path, mesh: ExtractedMesh, colors: Array | None) -> None:
    """Plugins are imported only where one is needed."""
    from ndf_core.plugins.companions import export

    export(output, mesh, colors)
