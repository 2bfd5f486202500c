"""`ndf geodesics`: distances along a surface."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ndf_core.cli.processing import draw_surface, parse_point, read_surface, surface_options
from ndf_core.cli.result import Result, as_lines

if TYPE_CHECKING:
    from ndf_core.processing.geodesics import GeodesicMethod

_PICTURE_SIDE = 800


@click.command(short_help="Distances along a surface from given points.")
@click.option(
    "--source", "points", required=True, multiple=True, metavar="X,Y,Z", help="A point to measure from; repeatable."
)
@click.option(
    "--method",
    type=click.Choice(["heat", "exact"]),
    default="heat",
    show_default=True,
    help="heat: within a percent or so, seconds at most; exact: on the triangles, slow beyond 50,000 vertices.",
)
@click.option(
    "--to",
    "ends",
    multiple=True,
    metavar="X,Y,Z",
    help="Also trace the path from the first source; repeatable.",
)
@surface_options
def command(
    source: Path,
    points: tuple[str, ...],
    ends: tuple[str, ...],
    method: GeodesicMethod,
    output: Path,
    edge_length: float | None,
    picture: Path | None,
) -> Result:
    """Distance of every vertex to the nearest source, along the surface of an asset or of a mesh file.

    A source is the point of the surface closest to the point given, which may lie inside a triangle. Parts of the
    surface without a source are infinitely far away.
    """
    coordinates = [parse_point(text) for text in points]
    targets = [parse_point(text, "--to") for text in ends]
    start = time.perf_counter()
    mesh = read_surface(source, edge_length, output, picture)

    from ndf_core.processing.geodesic_paths import geodesic_path
    from ndf_core.processing.geodesics import geodesic_distances
    from ndf_core.processing.operators import Operators
    from ndf_core.processing.vertex_values import write_vertex_values
    from ndf_core.render import ColorBar, colormap, panels, write_png

    ready = time.perf_counter()
    operators = Operators.of(mesh.extracted or mesh)
    found = geodesic_distances(operators, coordinates, method)
    paths = [geodesic_path(operators, coordinates[0], target) for target in targets]
    solved = time.perf_counter()
    distances = found.distances
    arrays = {"distances": distances, **{f"source_{name}": value for name, value in found.sources._asdict().items()}}
    arrays |= {f"path_{i}": path.points for i, path in enumerate(paths)}
    colors = colormap(found.shown, 0.0, found.largest or 1.0)
    write_vertex_values(output, mesh, {"distance": distances}, colors, arrays)
    if picture is not None:
        title = f"distance to {'the source' if len(points) == 1 else f'the nearest of {len(points)} sources'}"
        bar = ColorBar(0.0, found.largest or 1.0, "distance")
        write_png(picture, panels([draw_surface(mesh, colors, _PICTURE_SIDE)], [title], color_bar=bar))
    report = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "method": method,
        "sources": found.sources.positions,
        "source_offsets": found.sources.offsets,
        "largest_distance": found.largest,
        "unreached_vertices": found.unreached_vertices,
        "unreached_components": found.unreached_components,
        "approximated": found.approximated,
        "path_lengths": [path.length for path in paths],
        "seconds": {"read": ready - start, "solve": solved - ready, "write": time.perf_counter() - solved},
        "notes": mesh.notes,
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")
