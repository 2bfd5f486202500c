"""What the commands that compute on a surface share: options, input, pictures."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.paths import check_output
from ndf_core.errors import ConfigError

if TYPE_CHECKING:
    from numpy import ndarray as Array

    from ndf_core.processing.mesh_input import InputMesh

_FARTHEST = 1e100
"""Squares of coordinates have to stay finite."""


def surface_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """INPUT, --output, --edge-length, --png, --json and --debug."""
    output = click.Path(path_type=Path)
    for decorate in (
        debug_option,
        json_option,
        click.option("--png", "picture", type=output, metavar="FILE", help="Also draw a picture, .png."),
        click.option(
            "--edge-length",
            type=float,
            metavar="H",
            help="Of the mesh extracted from an asset, in its input's units; 1/150 of the longest side if left out.",
        ),
        click.option("-o", "--output", required=True, type=output, help="The result: .ply or .npz."),
        click.argument("source", metavar="ASSET|MESH", type=output),
    ):
        command = decorate(command)
    return command


def read_surface(source: Path, edge_length: float | None, output: Path, picture: Path | None) -> InputMesh:
    """Check what can be checked before the work, then read the mesh, or extract it.

    Raises:
        NdfError: an option is wrong, a file cannot be read or written, or there is no mesh to compute on.
    """
    if edge_length is not None and not (math.isfinite(edge_length) and edge_length > 0):
        raise ConfigError(f"--edge-length {edge_length:g}: must be a positive length in the units of the input")
    check_output(output, (".ply", ".npz"), source)
    if picture is not None:
        check_output(picture, (".png",), source)

    from ndf_core.processing.mesh_input import read_input

    return read_input(source, edge_length, threads=os.cpu_count() or 1)


def parse_point(text: str, option: str = "--source") -> list[float]:
    """Three numbers with commas.

    Raises:
        ConfigError: it is something else.
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(abs(number) < _FARTHEST for number in numbers):
        raise ConfigError(f"{option} {text}: must be three numbers with commas, such as 0.5,0,-1")
    return numbers


def draw_surface(mesh: InputMesh, colors: Array, side: int) -> Array:
    """Picture of the mesh with the colours of its vertices, sRGB, `side` pixels high and wide."""
    from ndf_core.render import render_mesh

    threads = os.cpu_count() or 1
    return render_mesh(mesh.vertices, mesh.faces, width=side, height=side, colors=colors, threads=threads)
