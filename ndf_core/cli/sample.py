"""`ndf sample`: points spread over an asset's surface."""

from __future__ import annotations

import os
import time
from pathlib import Path

import click

from ndf_core.cli.app import debug_option, json_option
from ndf_core.cli.paths import check_output
from ndf_core.cli.processing import draw_surface
from ndf_core.cli.result import Result, as_lines
from ndf_core.errors import ConfigError

_PICTURE_SIDE = 800


@click.command(short_help="Points spread over an asset's surface.")
@click.argument("asset", metavar="ASSET.ndf", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The points: .ply or .npz.")
@click.option("--noise", type=click.Choice(["white", "blue"]), default="blue", show_default=True, help="How spread.")
@click.option("--count", type=int, help="How many; about so many for blue noise.")
@click.option("--radius", type=float, help="Least distance of blue noise, in the input's units; instead of --count.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--png", "picture", type=click.Path(path_type=Path), metavar="FILE", help="Also draw a picture, .png.")
@json_option
@debug_option
def command(
    asset: Path, output: Path, noise: str, count: int | None, radius: float | None, seed: int, picture: Path | None
) -> Result:
    """Points on the surface of ASSET.ndf, in the coordinates of its input; no mesh is extracted for them."""
    if (count is None) == (radius is None):
        raise ConfigError("give --count or --radius, and not both")
    if radius is not None and noise == "white":
        raise ConfigError("--radius is for blue noise; white noise has none")
    check_output(output, (".ply", ".npz"), asset)
    if picture is not None:
        check_output(picture, (".png",), asset)

    from ndf_core.asset.asset import Asset
    from ndf_core.processing.point_output import dotted_surface, write_samples
    from ndf_core.processing.surface_sampling import blue_noise, radius_for, white_noise

    start = time.perf_counter()
    loaded = Asset.load(asset)
    if noise == "white":
        assert count is not None
        found = white_noise(loaded, count, seed)
    else:
        found = blue_noise(loaded, radius if count is None else radius_for(loaded, count), seed)  # pyright: ignore[reportArgumentType]  # one of the two is given
    seconds = time.perf_counter() - start
    write_samples(output, found)
    if picture is not None:
        from ndf_core.render import write_png

        mesh, colors = dotted_surface(loaded, found, os.cpu_count() or 1)
        write_png(picture, draw_surface(mesh, colors, _PICTURE_SIDE))
    report = {"points": len(found.points), "noise": noise, "radius": found.radius, "seconds": seconds}
    return Result(report, f"{output}\n{as_lines(report, '  ')}")
