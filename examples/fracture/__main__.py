"""Fracture modes from server to client (paper Fig. `fracture-modes`; Sellan et al. 2023).

    python examples/fracture                       a bracket that this project ships: fits it first
    python examples/fracture ASSET.ndf             any asset of one closed component

The server finds the modes and ships them in the asset; the client cuts the surface once, and breaks it where it is
hit. Writes the asset with its modes, the broken meshes and one picture; prints sizes, errors and times.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from client import Shatter, volumes
from jaxtyping import UInt8
from numpy import ndarray as Array
from server import with_modes

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.meshio import write_mesh
from ndf_core.render import Camera, colormap, panels, render_mesh, write_png

HERE = Path(__file__).resolve().parent
SHIPPED = HERE.parent / "shapes" / "bracket.toml"
Image = UInt8[Array, "h w 3"]
EDGES = 30
"""The longest side over the edge length that the client cuts and spreads impacts on."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", nargs="?", type=Path)
    parser.add_argument("--modes", type=int, default=6)
    parser.add_argument("--spacing", type=float, default=0.12, help="of the solid's points / longest side")
    parser.add_argument("--steps", type=int, default=1500, help="training steps of the classifier")
    parser.add_argument("--output", type=Path, default=HERE.parents[1] / "demo" / "output")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    asset = ndf_core.load(arguments.asset) if arguments.asset else ndf_core.fit(ndf_core.open(SHIPPED), steps=600)
    stem = arguments.output / f"{arguments.asset.stem if arguments.asset else SHIPPED.stem}_fracture"

    began = time.process_time()
    fit, solid, modes = with_modes(asset, arguments.modes, arguments.spacing, steps=arguments.steps)
    fit.asset.save(stem.with_suffix(".ndf"))
    seconds = time.process_time() - began
    print(f"server   {len(solid.tetrahedra)} tetrahedra, {len(modes)} modes, {seconds:.0f} s of CPU")
    size, overlap = fit.report["field_bytes"], min(fit.report["held_out_overlap"])
    print(
        f"         {fit.report['columns']} pieces in {size:,} bytes, overlap at least {overlap:.3f} at fresh points"
    )

    asset = Asset.load(stem.with_suffix(".ndf"))
    began = time.process_time()
    shatter = Shatter(asset, asset.longest_side / EDGES)
    print(f"client   cut and factorised: {time.process_time() - began:.3f} s of CPU")
    images, titles = list[Image](), list[str]()
    for axis, name in enumerate("xyz"):
        point, direction = _impact(asset, axis)
        began = time.process_time()
        vertices, faces, piece = shatter.hit(point, direction)
        seconds = time.process_time() - began
        parts = volumes(vertices, faces, piece)
        print(f"impact   {1000 * seconds:.1f} ms of CPU, volumes {np.round(parts / parts.sum(), 3).tolist()}")
        write_mesh(f"{stem}_{name}.ply", vertices, faces)
        images.append(_drawn(asset, vertices, faces, piece))
        titles.append(f"hit along -{name}: {len(parts)} pieces")
    images.append(_drawn(asset, *shatter.pieces(np.arange(len(modes)))))
    titles.append("all modes at once")
    write_png(stem.with_suffix(".png"), panels(images, titles, columns=4))
    print(stem.with_suffix(".png"))


def _impact(asset: Asset, axis: int) -> tuple[Array, Array]:
    """The outermost point along an axis, hit towards the middle."""
    corners = asset.to_input(asset.content.vertices)
    face = np.flatnonzero((asset.content.faces == corners[:, axis].argmax()).any(axis=1))[:1].astype(np.int32)
    return asset.map_points(face, np.full((1, 3), 1 / 3))[0], -np.eye(3)[axis]


def _drawn(asset: Asset, vertices: Array, faces: Array, piece: Array) -> Image:
    """The pieces, a little apart."""
    count = int(piece.max()) + 1
    middle = np.stack([np.bincount(piece, vertices[faces].mean(axis=1)[:, axis]) for axis in range(3)], axis=1)
    middle /= np.bincount(piece)[:, None]
    owner = np.zeros(len(vertices), dtype=int)
    owner[faces.ravel()] = np.repeat(piece, 3)
    moved = vertices + 0.25 * (middle - asset.content.center)[owner]
    colors = colormap(np.arange(count) + 0.5, 0.0, float(count), "turbo")[owner]
    return render_mesh(moved, faces, colors=colors, width=480, height=480, view=Camera.framing(moved, (60.0, 20.0)))


if __name__ == "__main__":
    main()
