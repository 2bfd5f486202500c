"""`ndf spectrum`: the lowest eigenvalues and eigenfunctions of a surface."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ndf_core.cli.processing import draw_surface, read_surface, surface_options
from ndf_core.cli.result import Result, as_lines
from ndf_core.errors import ConfigError

if TYPE_CHECKING:
    from numpy import ndarray as Array

    from ndf_core.processing.operators import MassKind

_DRAWN = 8
"""Eigenfunctions in a picture."""
_PICTURE_SIDE = 400


@click.command(short_help="Lowest eigenvalues and eigenfunctions of a surface.")
@click.option("-k", "--count", type=int, default=20, show_default=True, help="How many.")
@click.option(
    "--mass",
    type=click.Choice(["mean", "lumped", "galerkin"]),
    default="mean",
    show_default=True,
    help="Mass matrix; mean is the most accurate on good meshes.",
)
@surface_options
def command(
    source: Path, count: int, mass: MassKind, output: Path, edge_length: float | None, picture: Path | None
) -> Result:
    """The smallest eigenpairs of the Laplace-Beltrami operator of an asset's surface or of a mesh file."""
    if count < 1:
        raise ConfigError(f"--count {count}: must be at least 1")
    start = time.perf_counter()
    mesh = read_surface(source, edge_length, output, picture)

    from ndf_core.processing.operators import Operators
    from ndf_core.processing.spectrum import laplace_spectrum
    from ndf_core.processing.vertex_values import write_vertex_values
    from ndf_core.render import panels, write_png

    ready = time.perf_counter()
    operators = Operators.of(mesh.extracted or mesh)
    found = laplace_spectrum(operators, count, mass)
    solved = time.perf_counter()
    functions = found.eigenfunctions
    constant = min(int(operators.components.max()) + 1, count - 1)
    colors = [_colors(functions[:, i]) for i in range(constant, min(constant + _DRAWN, count))]
    values = {f"eigenfunction_{i}": functions[:, i] for i in range(count)}
    arrays = {"eigenvalues": found.eigenvalues, "eigenfunctions": functions}
    write_vertex_values(output, mesh, values, colors[0], arrays)
    if picture is not None:
        images = [draw_surface(mesh, color, _PICTURE_SIDE) for color in colors]
        titles = [f"{i}: {found.eigenvalues[i]:.4g}" for i in range(constant, constant + len(colors))]
        write_png(picture, panels(images, titles, columns=4))
    report = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "area": operators.area,
        "eigenvalues": found.eigenvalues,
        "seconds": {"read": ready - start, "solve": solved - ready, "write": time.perf_counter() - solved},
        "notes": mesh.notes,
    }
    return Result(report, f"{output}\n{as_lines(report, '  ')}")


def _colors(values: Array) -> Array:
    """sRGB; zero in the middle of the map."""
    from ndf_core.render import colormap

    largest = float(abs(values).max())
    return colormap(values, -largest, largest, "turbo")
