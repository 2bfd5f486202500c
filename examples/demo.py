"""Fit a shape that is not a mesh, extract meshes at three edge lengths, draw them, print what happened.

    make demo                                       the showpiece of examples/shapes
    python examples/demo.py INPUT [--output DIR]    any input that `ndf fit` takes

Writes the asset, three meshes and one picture: input, base mesh, extracted mesh and error side by side.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

import ndf_core
from ndf_core.config.fit import FitConfig
from ndf_core.config.resolve import Given, resolve_config
from ndf_core.extract.extracted import ExtractedMesh
from ndf_core.fitting.pipeline import FitResult, run_fit
from ndf_core.interfaces import Surface
from ndf_core.meshio import write_mesh
from ndf_core.render import Camera, ColorBar, colormap, panels, render_mesh, write_png

HERE = Path(__file__).parent
SHOWPIECE = HERE / "shapes" / "teapot.toml"
FRACTIONS = (30, 75, 150)
"""The three edge lengths, as parts of the longest side; the last is the paper's h = 0.02 in a box of 3."""
DENSE_FACES = 60_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("input", nargs="?", default=str(SHOWPIECE))
    parser.add_argument("--faces", type=int, default=2000)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--output", type=Path, default=HERE.parent / "demo" / "output")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    stem = arguments.output / Path(arguments.input.replace(":", "_")).stem

    start = time.perf_counter()
    print(f"opening {arguments.input}")
    surface = ndf_core.open(arguments.input)
    given = Given(fit={"faces": arguments.faces, "steps": arguments.steps})
    config = resolve_config(given=given, training_defaults=surface.training_defaults).fit.config
    dense = surface.base_mesh.extract(DENSE_FACES)
    print("fitting ...")
    result = run_fit(surface, config, output=stem.with_suffix(".ndf"))
    meshes: list[tuple[float, ExtractedMesh]] = []
    for fraction in FRACTIONS:
        began = time.perf_counter()
        mesh = result.asset.extract(result.asset.longest_side / fraction, threads=2)
        meshes.append((time.perf_counter() - began, mesh))
        write_mesh(f"{stem}_{fraction}.ply", mesh.vertices, mesh.faces)
    picture = stem.with_suffix(".png")
    draw(picture, surface, (dense.vertices, dense.faces), result, config, [mesh for _, mesh in meshes])
    print_table(result, meshes)
    print(f"\n{picture}\n{time.perf_counter() - start:.0f} s in all")


def draw(
    path: Path,
    surface: Surface,
    dense: tuple[Array, Array],
    result: FitResult,
    config: FitConfig,
    meshes: list[ExtractedMesh],
) -> None:
    """Input, base mesh, extracted mesh and error, seen by one camera."""
    finest, shown = meshes[-1], meshes[0]
    camera = Camera.framing(
        dense[0], (35.0, 20.0), aspect=1.0, up="z" if surface.representation == "analytic" else "y"
    )
    error = distances(surface, finest.vertices) / result.asset.longest_side
    top = float(np.quantile(error, 0.99))
    content = result.asset.content
    base = content.vertices * content.scale + content.center
    size = {"width": 640, "height": 640, "view": camera}
    images = [
        render_mesh(*dense, **size),
        render_mesh(base, content.faces, wireframe=True, crease=0, **size),
        render_mesh(shown.vertices, shown.faces, wireframe=True, **size),
        render_mesh(finest.vertices, finest.faces, colors=colormap(error, 0.0, top, "heat"), **size),
    ]
    asset_bytes = result.report["asset_bytes"]
    titles = [
        f"input ({surface.representation})",
        f"base mesh, {len(content.faces):,} faces",
        f"extracted at 1/{FRACTIONS[0]}, {len(shown.vertices):,} vertices",
        f"error of {len(finest.vertices):,} vertices",
    ]
    caption = (
        f"asset {asset_bytes:,} bytes, fitted in {result.report['seconds']['train']:.1f} s ({config.steps} steps); "
        f"distance to the input: rms {result.report['projection_rms_relative']:.1e} of the longest side"
    )
    bar = ColorBar(0.0, top, "distance to the input / longest side", "heat")
    write_png(path, panels(images, titles, caption, color_bar=bar))


def distances(surface: Surface, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance from points to their projections on the input, in its units."""
    return (surface.projector.project(torch.from_numpy(points)).points - torch.from_numpy(points)).norm(dim=1).numpy()


def print_table(result: FitResult, meshes: list[tuple[float, ExtractedMesh]]) -> None:
    report = result.report
    base = report["base_mesh"]
    print(f"\nbase mesh   {base['faces']} faces, genus {base['genus']}, {base['components']} component(s)")
    print(f"asset       {report['asset_bytes']:,} bytes")
    print(f"fit         {report['seconds']['train']:.1f} s of training, {report['seconds']['total']:.1f} s in all")
    print(f"error       rms {report['projection_rms_relative']:.2e} of the longest side")
    print(f"\n{'edge length':>12} {'vertices':>10} {'faces':>10} {'seconds':>8}  closed manifold  Delaunay")
    for seconds, mesh in meshes:
        facts = mesh.statistics
        print(
            f"{mesh.edge_length:12.4g} {len(mesh.vertices):10,} {len(mesh.faces):10,} {seconds:8.3f}  "
            f"{facts['closed']!s:>6} {facts['manifold']!s:>8}  {facts['delaunay']:8.1%}"
        )


if __name__ == "__main__":
    main()
