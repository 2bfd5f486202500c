"""`ndf stripes`: evenly spaced stripes on a surface."""

from __future__ import annotations

import math
import time
from pathlib import Path

import click

from ndf_core.cli.processing import draw_surface, read_surface, surface_options
from ndf_core.cli.result import Result, as_lines
from ndf_core.errors import ConfigError

_PICTURE_SIDE = 800


@click.command(short_help="Evenly spaced stripes on a surface.")
@click.option("--period", required=True, type=float, help="Distance from stripe to stripe, in the input's units.")
@click.option(
    "-n",
    "--degree",
    type=click.IntRange(1, 2),
    default=2,
    show_default=True,
    help="Of the smoothest direction field that the stripes are across: 1 with a sign, 2 without.",
)
@surface_options
def command(
    source: Path, period: float, degree: int, output: Path, edge_length: float | None, picture: Path | None
) -> Result:
    """Cosine of the stripes' phase at every vertex: 1 on a stripe, -1 between two."""
    if not (math.isfinite(period) and period > 0):
        raise ConfigError(f"--period {period:g}: must be positive")
    start = time.perf_counter()
    mesh = read_surface(source, edge_length, output, picture)

    from ndf_core.processing.direction_fields import direction_field
    from ndf_core.processing.operators import Operators
    from ndf_core.processing.stripes import phase_gradients, stripe_pattern
    from ndf_core.processing.vertex_values import write_vertex_values
    from ndf_core.render import colormap, write_png

    ready = time.perf_counter()
    field = direction_field(Operators.of(mesh.extracted or mesh), degree)
    stripes = stripe_pattern(field, period)
    solved = time.perf_counter()
    cosines = stripes.cosines
    colors = colormap(cosines, -1.0, 1.0)
    arrays = {"stripes": cosines, "face_phases": stripes.phases, "face_indices": stripes.indices}
    write_vertex_values(output, mesh, {"stripes": cosines}, colors, arrays)
    if picture is not None:
        write_png(picture, draw_surface(mesh, colors, _PICTURE_SIDE))
    even = (stripes.indices == 0) & ~stripes.branched
    area = field.frames.areas * even
    gradient = float((phase_gradients(field.frames, stripes.phases) * area).sum() / area.sum())
    report = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "period": period,
        "mean_period": 2 * math.pi / gradient,
        "singular_faces": int((~even).sum()),
        "seconds": {"read": ready - start, "solve": solved - ready, "write": time.perf_counter() - solved},
        "notes": mesh.notes,
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")
