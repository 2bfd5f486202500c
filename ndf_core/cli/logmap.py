"""`ndf logmap`: the surface as seen from one of its points."""

from __future__ import annotations

import time
from pathlib import Path

import click

from ndf_core.cli.processing import draw_surface, parse_point, read_surface, surface_options
from ndf_core.cli.result import Result, as_lines
from ndf_core.errors import ConfigError

_PICTURE_SIDE = 800
_RINGS = 12


@click.command(short_help="The surface as seen from one of its points.")
@click.option(
    "--source", "points", required=True, multiple=True, metavar="X,Y,Z", help="The closest vertex is the origin."
)
@surface_options
def command(
    source: Path, points: tuple[str, ...], output: Path, edge_length: float | None, picture: Path | None
) -> Result:
    """Two coordinates of every vertex: its distance, in the direction to set out in (logarithmic map)."""
    coordinates = [parse_point(text) for text in points]
    if len(coordinates) > 1:
        raise ConfigError(f"--source: {len(points)} points; the surface is seen from one")
    start = time.perf_counter()
    mesh = read_surface(source, edge_length, output, picture)

    from ndf_core.processing.log_map import VectorHeat
    from ndf_core.processing.operators import Operators
    from ndf_core.processing.vertex_values import write_vertex_values
    from ndf_core.render import colormap, write_png

    ready = time.perf_counter()
    solver = VectorHeat(Operators.of(mesh.extracted or mesh))
    vertex = int(solver.nearest_vertices(coordinates)[0])
    found = solver.log_map(vertex)
    solved = time.perf_counter()
    distance = (found**2).sum(axis=1) ** 0.5
    largest = float(distance.max()) or 1.0
    colors = colormap(distance * _RINGS / largest % 1.0, 0.0, 1.0)
    write_vertex_values(output, mesh, {"log_u": found[:, 0], "log_v": found[:, 1]}, colors, {"log_map": found})
    if picture is not None:
        write_png(picture, draw_surface(mesh, colors, _PICTURE_SIDE))
    report = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "source_vertex": vertex,
        "largest_distance": largest,
        "seconds": {"read": ready - start, "solve": solved - ready, "write": time.perf_counter() - solved},
        "notes": mesh.notes,
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")
