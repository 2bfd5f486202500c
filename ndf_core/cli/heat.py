"""`ndf heat`: heat spreading over a surface from given points."""

from __future__ import annotations

import math
import time
from pathlib import Path

import click

from ndf_core.cli.processing import draw_surface, parse_point, read_surface, surface_options
from ndf_core.cli.result import Result, as_lines
from ndf_core.errors import ConfigError

_PICTURE_SIDE = 800


@click.command(short_help="Heat spreading over a surface from given points.")
@click.option("--source", "points", required=True, multiple=True, metavar="X,Y,Z", help="Where; repeatable.")
@click.option("--time", "duration", required=True, type=float, help="Squared units: heat comes its root far.")
@click.option("--steps", type=int, default=16, show_default=True, help="Implicit steps that the time is cut into.")
@surface_options
def command(
    source: Path,
    points: tuple[str, ...],
    duration: float,
    steps: int,
    output: Path,
    edge_length: float | None,
    picture: Path | None,
) -> Result:
    """Temperature of every vertex some time after a unit of heat was put on each source (closest points)."""
    coordinates = [parse_point(text) for text in points]
    if not (math.isfinite(duration) and duration > 0):
        raise ConfigError(f"--time {duration:g}: must be positive")
    if steps < 1:
        raise ConfigError(f"--steps {steps}: must be at least 1")
    start = time.perf_counter()
    mesh = read_surface(source, edge_length, output, picture)

    from ndf_core.processing.heat_flow import diffuse
    from ndf_core.processing.operators import Operators
    from ndf_core.processing.vertex_values import write_vertex_values
    from ndf_core.render import ColorBar, colormap, panels, write_png

    ready = time.perf_counter()
    heat = diffuse(Operators.of(mesh.extracted or mesh), coordinates, duration, steps)
    solved = time.perf_counter()
    largest = float(heat.max()) or 1.0
    colors = colormap(heat, 0.0, largest, "turbo")
    write_vertex_values(output, mesh, {"heat": heat}, colors, {"heat": heat})
    if picture is not None:
        bar = ColorBar(0.0, largest, "heat")
        write_png(picture, panels([draw_surface(mesh, colors, _PICTURE_SIDE)], ["heat"], color_bar=bar))
    report = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "time": duration,
        "largest": float(heat.max()),
        "least": float(heat.min()),
        "seconds": {"read": ready - start, "solve": solved - ready, "write": time.perf_counter() - solved},
        "notes": mesh.notes,
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")
