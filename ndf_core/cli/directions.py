"""`ndf directions`: the smoothest direction field of a surface."""

from __future__ import annotations

import time
from pathlib import Path

import click

from ndf_core.cli.processing import draw_surface, read_surface, surface_options
from ndf_core.cli.result import Result, as_lines

_PICTURE_SIDE = 800


@click.command(short_help="The smoothest direction field of a surface.")
@click.option(
    "-n", "--degree", type=click.IntRange(1, 12), default=1, show_default=True, help="1 vectors, 2 lines, 4 crosses."
)
@surface_options
def command(source: Path, degree: int, output: Path, edge_length: float | None, picture: Path | None) -> Result:
    """One of the field's directions at every vertex, and where it is singular. The picture shows its x, y and z."""
    start = time.perf_counter()
    mesh = read_surface(source, edge_length, output, picture)

    from ndf_core.processing.direction_fields import direction_field
    from ndf_core.processing.operators import Operators
    from ndf_core.processing.vertex_values import write_vertex_values
    from ndf_core.render import write_png

    ready = time.perf_counter()
    field = direction_field(Operators.of(mesh.extracted or mesh), degree)
    solved = time.perf_counter()
    vectors = field.vectors
    # The sign of a line, or which arm of a cross, has no meaning: squares do not show it.
    colors = vectors / 2 + 0.5 if degree == 1 else vectors**2
    values = {f"direction_{axis}": vectors[:, i] for i, axis in enumerate("xyz")}
    arrays = {"directions": vectors, "face_indices": field.indices}
    write_vertex_values(output, mesh, values, colors, arrays)
    if picture is not None:
        write_png(picture, draw_surface(mesh, colors, _PICTURE_SIDE))
    report = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "degree": degree,
        "singular_faces": int((field.indices != 0).sum()),
        "index_sum": field.index_sum,
        "euler_characteristic": field.frames.euler_characteristic,
        "energy": field.energy,
        "seconds": {"read": ready - start, "solve": solved - ready, "write": time.perf_counter() - solved},
        "notes": mesh.notes,
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")
